"""Coverage of calibrated intervals: shares of the pixels whose 95 % interval holds the truth.

    bench_intervals.py [CASE ...] [--devices 20]

Cameras of counts and of bits (`tests/sensor/calibrate/counters.py`) are simulated as 20 devices,
recorded in the dark and under three lights, and calibrated (`calibrate_counts`). With crosstalk,
each avalanche fires 0.04 neighbors, dead time is 1 µs, lights are dimmer, and intervals are those
without what coincidences show. A row has the share, its binomial standard error over all
intervals, that from the scatter of devices, and of the devices' dead times.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from megalopta.camera.calibration import primary
from megalopta.sensor import changed
from megalopta.sensor.calibrate.counting import calibrate_counts
from tests.sensor.calibrate import counters

_FIRED = {"mean_fired_neighbors": 0.04}
_DIM = {"dark": (2e-3, 1e-2), "lights": (5e4, 5e5, 5e6)}
_LONG = {"dead_time_s": 1e-6}
CASES = {
    "counts": ({"dead_time_s": 0}, {}, {}),
    "counts, nonparalyzable dead time": ({}, {}, {}),
    "counts, paralyzable dead time": ({"kind": "paralyzable"}, {}, {}),
    "counts, crosstalk": ({"dead_time_s": 0}, {"crosstalk": _FIRED}, _DIM),
    "counts, crosstalk, nonparalyzable": (_LONG, {"crosstalk": _FIRED}, _DIM),
    "bits": (
        {"capacity": 1, "dead_time_s": 0},
        {},
        {"frames": 3000, "dark": (1e-3, 1e-2), "flat": 1e-5, "lights": (1e5, 5e5)},
    ),
}
"""Name of a case: its camera, more effects, and how it is recorded"""


def covered(seed, camera, effects, recorded):
    """Shares of a device's intervals of dark counts and efficiency, and whether its dead time's."""
    sensor = changed(counters.camera(seed, **camera), **effects)
    found = calibrate_counts(counters.levels_of(sensor, **recorded))
    shares = []
    for estimate, truth in (
        (found.dark_counts_hz, counters.dark_rates(sensor)),
        (found.efficiency, counters.sensitivity(seed)),
    ):
        own = primary(estimate, found.kernel)
        known = np.isfinite(own.low)
        shares.append(((own.low <= truth) & (truth <= own.high))[known])
    dead = found.dead_time
    off = None if dead is None else (dead.seconds - sensor.dead_time.dead_time_s) / dead.error
    return shares, off


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("cases", nargs="*", choices=[*CASES, []], metavar="CASE")
    parser.add_argument("--devices", type=int, default=20)
    options = parser.parse_args()
    for name in options.cases or CASES:
        shares, off = zip(*(covered(k, *CASES[name]) for k in range(options.devices)), strict=True)
        for quantity, held in zip(
            ("dark counts", "efficiency"), zip(*shares, strict=True), strict=True
        ):
            every, each = np.concatenate(held), np.array([device.mean() for device in held])
            errors = np.sqrt(0.95 * 0.05 / every.size), each.std(ddof=1) / np.sqrt(each.size)
            held = f"{100 * every.mean():6.1f} % ± {100 * errors[0]:.1f}"
            print(f"{name:36s}{quantity:12s}{every.size:7d} intervals{held}, "
                  f"of devices ± {100 * errors[1]:.1f}", flush=True)  # fmt: skip
        found = np.array([each for each in off if each is not None])
        if found.size:
            print(f"{name:36s}dead time   {found.size:7d} intervals"
                  f"{100 * (abs(found) < 1.96).mean():6.1f} %, z from {found.min():.1f} to "
                  f"{found.max():.1f}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
