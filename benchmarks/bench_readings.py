"""Corrected frames (docs/results/sensors.md), and full counters in the dark (theory/device.md)."""

import sys
from pathlib import Path

import numpy as np

from megalopta.sensor import DigitalCounter, Sensor, changed, expose_rate, preset
from megalopta.sensor.calibrate.correction import correct, simulated_calibration
from megalopta.sensor.spad.device import draw_fixed_pattern

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.sensor.calibrate.test_correction import SENSORS

SHAPE, FRAMES, DEVICES = (16, 16), 4000, 200
SHARES = 0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8


def corrected(sensor: Sensor, share: float) -> str:
    """Return how far mean and stated variance of corrected frames are off in uniform light."""
    calibration = simulated_calibration(sensor, SHAPE, frames=FRAMES)
    light = float(calibration.curve.arrivals_of(np.array([share * calibration.curve.largest]))[0])
    factor = draw_fixed_pattern(sensor, SHAPE).efficiency_factor
    rate = np.full((FRAMES, *SHAPE), light / sensor.exposure_s) * factor
    exposure = expose_rate(rate, sensor, seed=1, stream=f"{share}")
    frames = correct(exposure.counts, exposure.saturated, calibration)
    good = ~frames.filled.any(axis=0)
    mean, drawn = frames.detections[:, good].mean(), frames.detections.var(axis=0)[good].mean()
    of_gain = calibration.dark_variance + light**2 * calibration.gain_variance
    of_calibration = (of_gain / calibration.gain**2)[good].mean()
    stated = frames.variance[:, good].mean() - of_calibration
    error = np.sqrt((drawn / FRAMES + of_calibration) / good.sum()) / light
    ends = f"{mean / light - 1:+.2%} ± {error:.2%}"
    return f"mean off by {ends}, stated over drawn variance {stated / drawn:.3f}"


def near_capacity(capacity: int, share: float) -> str:
    """Return the share of saturated readings, and how much darker corrected frames are."""
    sensor = changed(preset("ideal"), counter=DigitalCounter(capacity=capacity))
    calibration = simulated_calibration(sensor, SHAPE, frames=FRAMES)
    rate = np.full((FRAMES, *SHAPE), share * capacity / sensor.exposure_s)
    exposure = expose_rate(rate, sensor, seed=1, stream="even")
    frames = correct(exposure.counts, exposure.saturated, calibration)
    darker = 1 - frames.detections.mean() / (share * capacity)
    return f"| {capacity} | {share:.0%} | {exposure.saturated.mean():.2%} | {darker:.2%} |"


def full_counters(device: int, exposure_s: float) -> int:
    """Return how many of 16 counters are full after an exposure in the dark at 13.68 V."""
    at_13_68_v = {"device_seed": device, "exposure_s": exposure_s, "bias": {"excess_v": 1.28}}
    sensor = changed(preset("spadcam"), **at_13_68_v)
    return int(expose_rate(np.zeros((1, 1, 16)), sensor, seed=0, stream="").saturated.sum())


if __name__ == "__main__":
    for name in ("spadcam", "nonparalyzable", "paralyzable"):
        # at 80 % paralyzable readings are ambiguous
        for share in SHARES[: 6 if name == "paralyzable" else 7]:
            print(f"{name}, {share:.0%}: {corrected(SENSORS[name], share)}", flush=True)
    for capacity, shares in ((15, (0.3, 0.5, 0.7)), (63, (0.5, 0.7, 0.8)), (255, (0.7, 0.8, 0.9))):
        print(*(near_capacity(capacity, share) for share in shares), sep="\n")
    for exposure_s in (0.1, 0.5, 1.0):
        full = [full_counters(device, exposure_s) for device in range(DEVICES)]
        error = np.std(full) / DEVICES**0.5
        print(f"full counters of 16 in {exposure_s} s: {np.mean(full):.2f} ± {error:.2f}")
