"""Coverage of calibrated intervals, on devices of an own event-by-event simulation.

For each kind of camera, 20 devices (`--devices`) with dark counts and efficiencies of their own are
recorded, calibrated from these recordings, and compared with the truth: the share of pixels whose
95 % CI holds it, for dark counts and efficiency of the device file, and the number of devices whose
dead time is of the right kind, within its interval. ± is the standard error from the scatter
between devices. Kinds by name as arguments; default: all.

Wanted: 93 to 97 %.
"""

import argparse
import heapq
import warnings
from typing import Any

import numpy as np

from megalopta.camera.calibration import calibration_of
from megalopta.core.compiling import compiled
from megalopta.sensor import preset
from megalopta.sensor.calibrate.counts import calibrate_counts, summed

PRIMARY, FIRED, TWILIGHT = 0, 1, 2
WAVELENGTH_NM, EFFICIENCY = 600.0, 0.2
CURVE, LINE = (5e4, 5e5, 2e6, 3e6), (5e4, 5e5)
MICROSECOND = {"tau_s": 1e-6, "lights_hz": CURVE}
TRAPS = {"carriers": 0.04, "delay_s": 2e-6}
ALIKE = {"vertical": (0.01, 0.01), "horizontal": 0.01}
PAIRS = {"vertical": (0.02, 0.002), "horizontal": 0.005, "sigma": 0.6}
KINDS: dict[str, dict[str, Any]] = {
    "counts": {},
    "hot pixels": {"hot": 0.05},
    "log-normal dark counts, σ 0.6": {"sigma": 0.6},
    "bits": {"is_binary": True, "frames": 2000, "flat_s": 1e-5, "lights_hz": (1e5, 5e5)},
    "afterpulses": TRAPS,
    "crosstalk": ALIKE,
    "crosstalk in pairs of rows": PAIRS,
    "crosstalk in pairs of rows, 64 × 64": PAIRS | {"side": 64},
    "nonparalyzable": MICROSECOND,
    "paralyzable": MICROSECOND | {"is_paralyzable": True},
    "nonparalyzable, afterpulses": MICROSECOND | TRAPS,
    "paralyzable, afterpulses": MICROSECOND | TRAPS | {"is_paralyzable": True},
    "nonparalyzable, recharging": MICROSECOND | {"recharge_s": 5e-7},
    "nonparalyzable, twilight": MICROSECOND | {"twilight_s": 3e-7},
}


@compiled
def simulated(rng, rates_hz, frames, exposure_s, recovery, traps, kernel):  # type: ignore[no-untyped-def]
    """Return counts (frames, rows, columns), event by event.

    `recovery` is dead time, twilight and recharging (s), and 1 if paralyzable; `traps` the mean
    number of carriers and their delay (s); `kernel` the chance to fire each of 3 × 3 neighbors, by
    parity of the row.
    """
    rows, columns = rates_hz.shape
    rates_hz, number = rates_hz.ravel(), rates_hz.size
    tau_s, twilight_s, recharge_s, is_paralyzable = recovery
    group = number if kernel.sum() > 0 else 1
    counts = np.zeros((frames, number), np.uint16)
    ready_s, has_fired, pulse_s = np.zeros(number), np.zeros(number), np.zeros(number)
    for frame in range(frames):
        ready_s[:], has_fired[:], pulse_s[:] = 0.0, 0.0, -1.0
        for first in range(0, number, group):
            queue = [(0.0, 0, 0) for _ in range(0)]
            for pixel in range(first, first + group):
                time_s = rng.exponential(1 / rates_hz[pixel])
                heapq.heappush(queue, (time_s, pixel, PRIMARY))
            while len(queue) > 0 and queue[0][0] < exposure_s:
                time_s, pixel, source = heapq.heappop(queue)
                if source == PRIMARY:
                    later_s = time_s + rng.exponential(1 / rates_hz[pixel])
                    heapq.heappush(queue, (later_s, pixel, PRIMARY))
                if time_s < ready_s[pixel]:
                    if is_paralyzable > 0:
                        ready_s[pixel] = time_s + tau_s
                    elif time_s > ready_s[pixel] - twilight_s and pulse_s[pixel] < ready_s[pixel]:
                        pulse_s[pixel] = ready_s[pixel]
                        heapq.heappush(queue, (ready_s[pixel], pixel, TWILIGHT))
                    continue
                waited_s = time_s - ready_s[pixel]
                is_slow = recharge_s > 0 and has_fired[pixel] > 0
                if is_slow and rng.random() < np.exp(-waited_s / recharge_s):
                    continue
                counts[frame, pixel] += 1
                ready_s[pixel], has_fired[pixel] = time_s + tau_s, 1.0
                for _ in range(rng.poisson(traps[0])):
                    later_s = time_s + rng.exponential(traps[1])
                    heapq.heappush(queue, (later_s, pixel, FIRED))
                row, column = pixel // columns, pixel % columns
                for place in range(9 if group > 1 else 0):
                    down, right = place // 3 - 1, place % 3 - 1
                    is_inside = 0 <= row + down < rows and 0 <= column + right < columns
                    if is_inside and rng.random() < kernel[row % 2, down + 1, right + 1]:
                        other = pixel + down * columns + right
                        heapq.heappush(queue, (time_s, other, FIRED))
    return counts.reshape(frames, rows, columns)


def calibrated(
    seed: int,
    *,
    side: int = 24,
    frames: int = 300,
    dark_s: tuple[float, ...] = (2e-3, 1e-2),
    flat_s: float = 1e-4,
    lights_hz: tuple[float, ...] = LINE,
    sigma: float = 0.0,
    hot: float = 0.0,
    tau_s: float = 0.0,
    twilight_s: float = 0.0,
    recharge_s: float = 0.0,
    is_paralyzable: bool = False,
    carriers: float = 0.0,
    delay_s: float = 1e-6,
    vertical: tuple[float, float] = (0.0, 0.0),
    horizontal: float = 0.0,
    is_binary: bool = False,
) -> tuple[float, float, float]:
    """Return the shares of dark counts and efficiencies covered, and 1 if the dead time is.

    NaN of a dead time if there is none.
    """
    rng = np.random.default_rng(seed)
    shape = side, side
    scatter = np.exp(sigma * rng.standard_normal(shape)) if sigma else rng.uniform(0.5, 1.5, shape)
    dark_hz = 100 * scatter * np.where(rng.random(shape) < hot, 100.0, 1.0)
    efficiency = EFFICIENCY * rng.uniform(0.8, 1.2, shape)
    kernel = np.zeros((2, 3, 3))
    kernel[:, 1, [0, 2]] = horizontal
    kernel[0, 2, 1] = kernel[1, 0, 1] = vertical[0]  # rows 0 and 1, 2 and 3, …
    kernel[1, 2, 1] = kernel[0, 0, 1] = vertical[1]
    recovery = np.array([tau_s, twilight_s, recharge_s, is_paralyzable], np.float64)
    levels = []
    for exposure_s, light_hz in [*((s, 0.0) for s in dark_s), *((flat_s, hz) for hz in lights_hz)]:
        rates_hz, traps = dark_hz + efficiency * light_hz, np.array([carriers, delay_s])
        counts = simulated(rng, rates_hz, frames, exposure_s, recovery, traps, kernel)
        readings = np.minimum(counts, 1) if is_binary else counts
        levels.append(summed(readings, exposure_s, light_hz, is_binary=is_binary))
    base, device = preset("ideal"), calibrate_counts(levels)
    maps = calibration_of(device, base, WAVELENGTH_NM).maps
    truth = efficiency / base.photon_detection_efficiency(np.array(WAVELENGTH_NM))
    covered = [
        float(np.mean((of.low <= true) & (true <= of.high)))
        for of, true in ((maps["dark_counts"], dark_hz), (maps["efficiency"], truth))
    ]
    if not tau_s:
        return covered[0], covered[1], np.nan
    dead, kind = device.dead_time, "paralyzable" if is_paralyzable else "nonparalyzable"
    if dead is None:
        print(device.refused, flush=True)
        return covered[0], np.nan, 0.0
    is_right = dead.recovery.kind == kind
    is_right &= abs(dead.recovery.dead_s - tau_s) < 1.96 * dead.error_s
    is_right &= bool(dead.recovery.recharge_s) == bool(recharge_s)
    is_right &= bool(dead.recovery.twilight_s) == bool(twilight_s)
    return covered[0], covered[1], float(is_right)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("kinds", nargs="*", default=list(KINDS))
    parser.add_argument("--devices", type=int, default=20)
    chosen = parser.parse_args()
    warnings.simplefilter("error", RuntimeWarning)
    print("| camera | dark counts: covered, % | efficiency: covered, % | kind and dead time |")
    print("|---|---|---|---|")
    for name in chosen.kinds:
        seen = np.array([calibrated(seed, **KINDS[name]) for seed in range(chosen.devices)])
        shares, errors = 100 * seen.mean(axis=0), 100 * seen.std(axis=0) / len(seen) ** 0.5
        cells = [f"{shares[at]:.1f} ± {errors[at]:.1f}" for at in (0, 1)]
        dead = "–" if np.isnan(shares[2]) else f"{seen[:, 2].sum():.0f} of {len(seen)}"
        print(f"| {' | '.join([name, *cells, dead])} |", flush=True)
