"""Speed of drawing counts per core, each against a reference measured in the same run.

Frames of 240 × 240 pixels whose mean counts spread by a factor of 3. The first two lines, and the
last, compare with NumPy's `Generator.poisson` on the same means and bit generator (1 means as
fast); "by event" with a plain event-by-event simulation in numba; "binary" with
`Generator.binomial(1, p)`. Medians of alternating repeats, one thread, but for "two threads", which
is the speed with two threads over that with one.

Floors: ideal 0.9, SPADCAM 0.2, SPADCAM at 300 counts by event 20, binary 10.
"""

import time
from collections.abc import Callable

import numpy as np

from megalopta.sensor import (
    Afterpulsing,
    expose,
    expose_binary,
    expose_rate,
    preset,
)
from megalopta.sensor.binary import draw_binary
from megalopta.sensor.brute_force import brute_force_counts
from megalopta.sensor.device import fabricate
from megalopta.sensor.randomness import generator

SHAPE = (4, 240, 240)
REPEATS = 7
MEAN_COUNTS = (1, 10, 30, 90, 300)


def ratio(ours: Callable[[], object], reference: Callable[[], object]) -> float:
    """Speed of ours over the reference's."""
    ours(), reference()
    seconds = np.array([(clock(ours), clock(reference)) for _ in range(REPEATS)])
    medians = np.median(seconds, axis=0)
    return float(medians[1] / medians[0])


def clock(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def light(mean_counts: float, name: str) -> np.ndarray:
    """Detection rates that give so many counts on average, dark counts included."""
    sensor = preset(name)
    shape = np.random.default_rng(0).uniform(0.5, 1.5, SHAPE) * mean_counts / sensor.exposure_s
    return np.maximum(shape - fabricate(sensor, SHAPE[1:]).dark_counts_hz, 0.0)


def frames_over_poisson(name: str, mean_counts: float) -> float:
    sensor, rate, rng = preset(name), light(mean_counts, name), generator(0)
    draw = lambda: expose_rate(rate, sensor, seed=0, sequence="bench", threads=1)  # noqa: E731
    means = draw().expected
    return ratio(draw, lambda: rng.poisson(means))


def frames_by_event(name: str, mean_counts: float, **effects: object) -> float:
    sensor, rng = preset(name).model_copy(update=effects), generator(0)
    rate = light(mean_counts, name)
    pixel_hz, pixels = mean_counts / sensor.exposure_s, rate.size
    return ratio(
        lambda: expose_rate(rate, sensor, seed=0, sequence="bench", threads=1),
        lambda: brute_force_counts(
            rng, pixel_hz, sensor.exposure_s, sensor.avalanche_effects, pixels
        ),
    )


def two_threads(name: str) -> float:
    sensor, rate = preset(name), light(30, name)
    return ratio(
        lambda: expose_rate(rate, sensor, seed=0, sequence="bench", threads=2),
        lambda: expose_rate(rate, sensor, seed=0, sequence="bench", threads=1),
    )


def binary_over_binomial(p: float) -> tuple[float, float]:
    """Of the draw from given probabilities, and of the whole step from rates to packed frames."""
    chances = np.random.default_rng(0).uniform(0.5 * p, min(1.5 * p, 1), SHAPE[1:])
    rng, sensor = generator(0), preset("ideal")
    rates = np.broadcast_to(-np.log1p(-chances) / sensor.exposure_s, SHAPE)
    frames = np.broadcast_to(chances, SHAPE)
    return (
        ratio(lambda: draw_binary(rng, chances), lambda: rng.binomial(1, chances)),
        ratio(
            lambda: expose_binary(rates, sensor, seed=0, sequence="bench", threads=1),
            lambda: rng.binomial(1, frames),
        ),
    )


def scene_over_poisson(name: str) -> float:
    radiance = np.random.default_rng(0).uniform(0, 1e-9, (*SHAPE, 3)).astype(np.float32)
    bands = [(400.0, 500.0), (500.0, 600.0), (600.0, 700.0)]
    sensor, rng = preset(name), generator(0)
    draw = lambda: expose(radiance, bands, sensor, seed=0, sequence="bench", threads=1)  # noqa: E731
    means = draw().expected
    return ratio(draw, lambda: rng.poisson(means))


def line(name: str, values: list[float]) -> None:
    print(f"{name:>34}" + "".join(f"{value:8.2f}" for value in values), flush=True)


if __name__ == "__main__":
    line("mean counts", list(MEAN_COUNTS))
    for name in ("ideal", "spadcam"):
        line(f"{name}, poisson", [frames_over_poisson(name, mean) for mean in MEAN_COUNTS])
    line("spadcam, by event", [frames_by_event("spadcam", mean) for mean in MEAN_COUNTS])
    traps = Afterpulsing(mean_carriers=0.1, delay_s=1e-5)
    line(
        "with afterpulsing, by event",
        [frames_by_event("spadcam", mean, afterpulsing=traps) for mean in MEAN_COUNTS],
    )
    line(
        "binary, binomial (p .02 .2 .6)",
        [binary_over_binomial(p)[0] for p in (0.02, 0.2, 0.6)],
    )
    line(
        "rates to packed frames, the same",
        [binary_over_binomial(p)[1] for p in (0.02, 0.2, 0.6)],
    )
    line("two threads, ideal and spadcam", [two_threads(name) for name in ("ideal", "spadcam")])
    line(
        "radiance to counts, the same", [scene_over_poisson(name) for name in ("ideal", "spadcam")]
    )
