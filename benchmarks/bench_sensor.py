"""Speed of drawing counts, against NumPy's `Generator.poisson` on the same means in the same run.

Prints pixels per second of each dead-time law as a multiple of NumPy's (1 means as fast), and of
the whole step from radiance to counts. Medians of alternating repeats, one core.
"""

import time
from collections.abc import Callable

import numpy as np

from megalopta.sensor import DeadTime, expose, preset
from megalopta.sensor.dead_time import draw_counts, expected_counts
from megalopta.sensor.randomness import generator

PIXELS = 240 * 240
REPEATS = 9
EXPOSURE_S = 0.1
LAWS = {
    "ideal": DeadTime(),
    "nonparalyzable, 1 µs": DeadTime(kind="nonparalyzable", dead_time_s=1e-6),
    "nonparalyzable, 100 µs": DeadTime(kind="nonparalyzable", dead_time_s=1e-4),
    "paralyzable, 1 µs": DeadTime(kind="paralyzable", dead_time_s=1e-6),
    "paralyzable, 100 µs": DeadTime(kind="paralyzable", dead_time_s=1e-4),
}
MEAN_COUNTS = (0.1, 1, 10, 30, 90, 300)


def ratio(ours: Callable[[], object], reference: Callable[[], object]) -> float:
    """Speed of ours over the reference's."""
    ours()
    seconds = np.array([(clock(ours), clock(reference)) for _ in range(REPEATS)])
    medians = np.median(seconds, axis=0)
    return float(medians[1] / medians[0])


def clock(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def law_ratio(law: DeadTime, mean_counts: float) -> float:
    shape = np.random.default_rng(0).uniform(0.5, 1.5, PIXELS)
    rate = shape * mean_counts / EXPOSURE_S
    means = expected_counts(rate, EXPOSURE_S, law)
    rng = generator(0)
    return ratio(lambda: draw_counts(rng, rate, EXPOSURE_S, law), lambda: rng.poisson(means))


def expose_ratio(name: str) -> float:
    radiance = np.random.default_rng(0).uniform(0, 1e-9, (24, 120, 120, 3)).astype(np.float32)
    bands = [(400.0, 500.0), (500.0, 600.0), (600.0, 700.0)]
    sensor, rng = preset(name), generator(0)
    means = expose(radiance, bands, sensor, seed=0, sequence="bench").expected
    return ratio(
        lambda: expose(radiance, bands, sensor, seed=0, sequence="bench"),
        lambda: rng.poisson(means),
    )


if __name__ == "__main__":
    print("speed over numpy Generator.poisson on the same means (same bit generator)")
    print(f"{'mean arrivals':>24}" + "".join(f"{mean:>8g}" for mean in MEAN_COUNTS))
    for name, law in LAWS.items():
        print(f"{name:>24}" + "".join(f"{law_ratio(law, mean):8.2f}" for mean in MEAN_COUNTS))
    for name in ("ideal", "spadcam"):
        print(f"radiance to counts, {name}: {expose_ratio(name):.2f}")
