"""Draw camera-motion.png: errors of camera motion in a forest with parallax, over the light.

Likelihood: the most likely motion; fitted: the motion that best fits the flow of blocks; summed:
weighted responses, learned from the noise-free first half. The number of flights is an argument.
"""

import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from forest_flight import CAMERA, FRAMES, flight

from megalopta.core.arrays import Floats
from megalopta.flow import METHODS, draw_counts, likely_camera_motion
from megalopta.flow.camera_motion import motion_of_flow
from megalopta.flow.detectors.registry import velocity_method
from megalopta.flow.metrics.endpoint_error import angles_deg
from megalopta.report.style import BLACK, GRAY, NUMBERS, house_style, method_style

FLUXES, WARM_UP, HALF = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0), 16, 47
DASHES = {"summed": ":", "fitted": "--", "2 frames": "--", "8 frames": "-"}
MIDDLES = np.arange(HALF, FRAMES - 4, 8)
CENTERS = velocity_method("PPF").grid((CAMERA.height, CAMERA.width)).centers


def summed(learned: Floats, rates: Floats, responses: Floats) -> Floats:
    """Return the rate (T,) of responses (T, ...), by weights learned at known rates.

    The weight of a response is its slope over the rate, divided by the variance around it, half of
    which is that of all places. The square of a noisy slope is too large: the product of the slopes
    of both halves takes its place (Krapp and Hengstenberg 1996; Franz and Krapp 2000).
    """
    learned, responses = (each.reshape(len(each), -1) for each in (learned, responses))
    half = len(rates) // 2
    slopes = []
    for part in (slice(None, half), slice(half, None), slice(None)):
        omega = np.where(np.isfinite(learned[part]), rates[part, np.newaxis], 0)
        slopes.append(
            np.nansum(learned[part] * omega, axis=0) / np.maximum((omega**2).sum(0), 1e-9)
        )
    first, second, both = slopes
    variance = np.nanmean((learned - both * rates[:, np.newaxis]) ** 2, axis=0)
    noise = (np.nanmedian(variance) + np.nan_to_num(variance, nan=np.inf)) / 2
    known = np.isfinite(responses)
    sums = np.where(known, responses, 0) @ ((first + second) / 2 / noise)
    return np.asarray(sums / (known @ (first * second / noise)))


yaw_errors: Any = defaultdict(list)
angles: Any = defaultdict(list)
for seed in range(int(sys.argv[1]) if len(sys.argv) > 1 else 1):
    light, yaw_deg, steps = flight(5 + seed)
    for flux in FLUXES:
        counts = draw_counts(light * flux, seed, "camera motion", f"{flux:g}")
        for name in ("BM", "EMD", "PM", "DIS"):
            first = int(METHODS[name].gives != "velocity")
            learned = METHODS[name].respond(light[: HALF + 1])[first + WARM_UP :]
            responses = METHODS[name].respond(counts, 1 / flux)[first:]
            rates = np.nan_to_num(summed(learned, yaw_deg[WARM_UP:HALF], responses))
            means = np.array([rates[at - 3 : at + 4].mean() for at in MIDDLES])
            yaw_errors[f"{name}, summed", flux] += [*(means - yaw_deg[MIDDLES])]
        for at in MIDDLES:
            flow = np.nan_to_num(METHODS["PPF"].respond(counts[at - 3 : at + 5])[-1])
            found = {"PPF, fitted": motion_of_flow(CAMERA, CENTERS, flow)}
            found["likelihood, 2 frames"] = likely_camera_motion(counts[at : at + 2], CAMERA)
            found["likelihood, 8 frames"] = likely_camera_motion(counts[at - 3 : at + 5], CAMERA)
            for name, motion in found.items():
                yaw_errors[name, flux].append(motion.rotation_deg[1] - yaw_deg[at])
                angles[name, flux].append(angles_deg(np.array(motion.heading), steps[at]))
with house_style():
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.3, 4.8), layout="constrained")
    for name in dict.fromkeys(name for name, _ in yaw_errors):
        method, _, how = name.partition(", ")
        look = method_style(method) if method in METHODS else {"color": BLACK, "marker": "o"}
        look["linestyle"] = (
            "--" if how in ("fitted", "2 frames") else ":" if how == "summed" else "-"
        )
        rms = [np.sqrt(np.mean(np.square(yaw_errors[name, flux]))) for flux in FLUXES]
        yaw_percent = 100 * np.array(rms) / np.sqrt(np.mean(yaw_deg[HALF:] ** 2))
        left.loglog(FLUXES, yaw_percent, label=name, **look)
        heading = [np.median(angles[name, flux] or np.nan) for flux in FLUXES]
        right.loglog(FLUXES, heading, **look)
        print(name, "yaw rate, %:", *yaw_percent.round(1), "heading, °:", *np.round(heading, 1))
    left.set(xlabel="photons per pixel", title="error of the yaw rate (%)")
    right.set(xlabel="photons per pixel", title="error of the heading (°)")
    for axes in (left, right):
        axes.axhline(5, color=GRAY, linewidth=1)
        axes.xaxis.set_major_formatter(NUMBERS)
        axes.yaxis.set_major_formatter(NUMBERS)
    figure.legend(loc="outside lower center", ncols=3)
    figure.savefig(Path(__file__).parent.parent / "camera-motion.png", dpi=100)
