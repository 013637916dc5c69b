"""Speed of drawing counts per core, each against a reference measured in the same run.

Frames of 240 × 240 pixels whose mean counts spread by a factor of 3. "poisson" compares with
NumPy's `Generator.poisson` on the same means and bit generator (1 means as fast), and so does
"radiance to counts"; "by event" with a plain event-by-event simulation in numba; "binary" with
`Generator.binomial(1, p)`; "comparison" with `random < 1 - exp(-mean)` and `np.packbits` in single
precision, which does not check its rates. "floor" compares with what cannot be left out, done by
NumPy: for ideal counts two random numbers each (one below 10 counts), for SPADCAM a Poisson count
and a random number each, for binary frames 16 random bits a pixel, from rates an `expm1` as well.
Medians of alternating repeats in processor time of one thread; "two threads" is the speed by the
clock with two threads over that with one and means something on an idle machine with two cores
only.

"frame cameras" compares frames of the IMX900 and the iXon 888, in electrons, with
`Generator.poisson` plus `Generator.standard_normal` of the same size.

"moments, in draws" is what mean and variance of the readings of a frame cost.

"stored" is what it takes to write events that are in memory: bytes and processor time of one, ns,
and the speed over that of `tobytes` of the same columns into plain files.

"calibrated" is the processor time of reading counts for a calibration (`summed`), 1000 frames of
512 × 512 pixels, over that of NumPy's `mean` and `var` of the same frames; "compared" that of
comparing 1000 dark and 1000 lit ones.

Least wanted: frame cameras 0.67, ideal 1.5, at 1e5 counts 1, SPADCAM 0.2, SPADCAM at 300 counts by
event 20, binary 10, comparison 1. Most wanted: 16 bytes and 100 ns a stored event, calibrated and
compared 8.
"""

import runpy
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from unittest.mock import patch

import numpy as np

from megalopta.sensor import (
    FRAME_PRESETS,
    Afterpulsing,
    DarkCounts,
    Sensor,
    changed,
    event_moments,
    expectation,
    expose,
    expose_binary,
    expose_events,
    expose_rate,
    preset,
    reading_moments,
)
from megalopta.sensor.calibrate.counts import summed
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.model import Model
from megalopta.sensor.compare.recordings import compare_levels
from megalopta.sensor.formats.events import EventOrigin, write_events_hdf5
from megalopta.sensor.frame.exposure import expose_frames as expose_camera
from megalopta.sensor.sampling.poisson import fill_bits
from megalopta.sensor.sampling.streams import Draw, generator, word_streams

PLAINEST = Path(__file__).parents[1] / "tests/sensor/plainest.py"
brute_force_events = runpy.run_path(str(PLAINEST))["brute_force_events"]
SHAPE = (4, 240, 240)
REPEATS = 7
MEAN_COUNTS = (1, 10, 30, 90, 300)
IDEAL_COUNTS = (0.01, 0.1, 1, 10, 90, 300, 1000, 1e5)


def ratio(
    ours: Callable[[], object],
    reference: Callable[[], object],
    clock: Callable[[], float] = time.process_time,
) -> float:
    """Speed of ours over the reference's."""
    ours(), reference()
    seconds = np.array([(timed(ours, clock), timed(reference, clock)) for _ in range(REPEATS)])
    medians = np.median(seconds, axis=0)
    return float(medians[1] / medians[0])


def timed(call: Callable[[], object], clock: Callable[[], float]) -> float:
    start = clock()
    call()
    return clock() - start


def bench_sensor(name: str) -> Sensor:
    """Return the preset without its dark counts; SPADCAM has 60 a frame, whatever the light."""
    return preset(name).model_copy(update={"dark_counts": DarkCounts()})


def light(mean_counts: float, sensor: Sensor) -> np.ndarray:
    """Detection rates that give so many counts on average."""
    return np.random.default_rng(0).uniform(0.5, 1.5, SHAPE) * mean_counts / sensor.exposure_s


def frames_over_poisson(name: str, mean_counts: float) -> float:
    sensor, rng = bench_sensor(name), generator(0)
    rate = light(mean_counts, sensor)
    draw = lambda: expose_rate(rate, sensor, seed=0, stream="bench")  # noqa: E731
    means, _ = event_moments(rate, sensor)
    return ratio(draw, lambda: rng.poisson(means))


def moments_in_draws(name: str, mean_counts: float) -> float:
    sensor = bench_sensor(name)
    rate = light(mean_counts, sensor)[:1]
    return 1 / ratio(
        lambda: reading_moments(rate, sensor),
        lambda: expose_rate(rate, sensor, seed=0, stream="bench"),
    )


def cameras_over_numpy(name: str, electrons: float) -> float:
    sensor, rng = FRAME_PRESETS[name], generator(0)
    rate = np.random.default_rng(0).uniform(0.5, 1.5, SHAPE) * electrons / sensor.exposure_s
    draw = lambda: expose_camera(rate, sensor, Draw(0, "bench"))  # noqa: E731
    return ratio(draw, lambda: rng.poisson(rate * 0.01) + rng.standard_normal(SHAPE))


def frames_over_floor(name: str, mean_counts: float) -> float:
    sensor, rng = bench_sensor(name), generator(0)
    rate = light(mean_counts, sensor)
    draw = lambda: expose_rate(rate, sensor, seed=0, stream="bench")  # noqa: E731
    means, _ = event_moments(rate, sensor)
    if name == "ideal":
        return ratio(draw, lambda: rng.random(rate.size * (1 if mean_counts < 10 else 2)))
    return ratio(draw, lambda: (rng.poisson(means), rng.random(rate.size)))


def frames_by_event(name: str, mean_counts: float, **effects: object) -> float:
    sensor, rng = bench_sensor(name).model_copy(update=effects), generator(0)
    rate = light(mean_counts, sensor)
    pixels_hz = np.full((rate.size, 1, 1), mean_counts / sensor.exposure_s)
    return ratio(
        lambda: expose_rate(rate, sensor, seed=0, stream="bench"),
        lambda: brute_force_events(rng, pixels_hz, sensor.exposure_s, sensor.avalanche_effects),
    )


def two_threads(name: str) -> float:
    sensor = bench_sensor(name)
    rate = np.tile(light(30, sensor), (8, 1, 1))
    return two_over_one(lambda: expose_rate(rate, sensor, seed=0, stream="bench"))


def two_threads_binary() -> float:
    sensor = bench_sensor("ideal")
    rate = np.tile(light(0.2, sensor), (8, 1, 1))
    return two_over_one(lambda: expose_binary(rate, sensor, seed=0, stream="bench"))


def two_over_one(task: Callable[[], object]) -> float:
    def on(cores: int) -> None:
        with patch("os.cpu_count", return_value=cores):
            task()

    return ratio(lambda: on(2), lambda: on(1), time.perf_counter)


def draw_bits(rng: np.random.Generator, means: np.ndarray) -> None:
    packed = np.empty((len(means), -(-means.shape[1] // 8)), np.uint8)
    fill_bits(word_streams(rng), means, np.zeros_like(means), 1.0, packed)


def binary_over_binomial(p: float) -> list[float]:
    """Of the draw from given probabilities, and of the whole step from rates to packed frames.

    Then the second against a comparison in single precision, and both against their floors.
    """
    chances = np.random.default_rng(0).uniform(0.5 * p, min(1.5 * p, 1), SHAPE)
    rng, sensor = generator(0), preset("ideal")
    means = -np.log1p(-chances)
    rates, singles = means / sensor.exposure_s, means.astype(np.float32)
    draw = lambda: [draw_bits(rng, frame) for frame in means]  # noqa: E731
    expose_all = lambda: expose_binary(rates, sensor, seed=0, stream="bench")  # noqa: E731
    binomial = lambda: [rng.binomial(1, frame) for frame in chances]  # noqa: E731
    compare = lambda: [  # noqa: E731
        np.packbits(rng.random(frame.shape, np.float32) < 1 - np.exp(-frame), axis=-1)
        for frame in singles
    ]
    words = lambda: [  # noqa: E731
        rng.integers(0, 2**64, frame.size // 4, np.uint64, endpoint=False) for frame in chances
    ]
    exponentials = np.empty(SHAPE[1:])
    return [
        ratio(draw, binomial),
        ratio(expose_all, binomial),
        ratio(expose_all, compare),
        ratio(draw, words),
        ratio(expose_all, lambda: (words(), [np.expm1(f, out=exponentials) for f in chances])),
    ]


def stored_event() -> list[float]:
    """Bytes of an event in a file, processor time for it, ns, and speed over plain files."""
    sensor = bench_sensor("ideal")
    events = expose_events(light(10, sensor), sensor, seed=0, stream="bench")
    period_s = sensor.exposure_s
    origin = EventOrigin(shape=events.shape, frame_period_s=period_s, exposure_s=period_s)
    columns = events.time_s.astype("<i8"), events.column.astype("<u2"), events.row.astype("<u2")
    with tempfile.TemporaryDirectory() as folder:
        path, plain = Path(folder) / "events.hdf5", Path(folder) / "plain"
        ours = lambda: write_events_hdf5(path, events, origin)  # noqa: E731
        reference = lambda: plain.write_bytes(b"".join(map(np.ndarray.tobytes, columns)))  # noqa: E731
        speed = ratio(ours, reference)
        seconds = np.median([timed(ours, time.process_time) for _ in range(REPEATS)])
        size = path.stat().st_size
    return [size / events.time_s.size, 1e9 * seconds / events.time_s.size, speed]


def calibrated_over_numpy() -> float:
    """Return the processor time of `summed` over that of NumPy's mean and variance."""
    few = np.random.default_rng(0).poisson(5.0, (100, 512, 512)).astype(np.uint16)
    frames = np.tile(few, (10, 1, 1))
    summed(frames[:100], 1e-3, 0.0, is_binary=False)
    ours = timed(lambda: summed(frames, 1e-3, 0.0, is_binary=False), time.process_time)
    return ours / timed(lambda: (frames.mean(axis=0), frames.var(axis=0)), time.process_time)


def scene_over_poisson(name: str) -> float:
    radiance = np.random.default_rng(0).uniform(0, 1e-9, (*SHAPE, 3)).astype(np.float32)
    bands = [(400.0, 500.0), (500.0, 600.0), (600.0, 700.0)]
    sensor, rng = preset(name), generator(0)
    draw = lambda: expose(radiance, bands, sensor, seed=0, stream="bench")  # noqa: E731
    means = expectation(radiance, bands, sensor).mean_events
    return ratio(draw, lambda: rng.poisson(means))


def comparison_over_numpy() -> float:
    sensor, shape = preset("ideal"), (1000, 512, 512)
    rates = [np.full((1, *shape[1:]), counts / sensor.exposure_s) for counts in (0.0, 30.0)]
    dark = 5 * np.random.default_rng(0).lognormal(0, 0.6, shape[1:]) / sensor.exposure_s
    with tempfile.TemporaryDirectory() as folder:
        np.save(f"{folder}/dark.npy", dark)
        device = changed(sensor, measured={"dark_counts": f"{folder}/dark.npy"})
        levels = []
        for number, rate_hz in enumerate(rates):
            frames = np.lib.format.open_memmap(f"{folder}/{number}.npy", "w+", np.uint16, shape)
            for start in range(0, len(frames), 50):
                rate = np.broadcast_to(rate_hz, (50, *shape[1:]))
                drawn = expose_rate(rate, device, seed=1, stream=f"{number}, {start}")
                frames[start : start + 50] = drawn.counts
            levels.append(Level(frames, sensor.exposure_s, 1e6 * number))
        model = Model(device, rates)
        compare = lambda: compare_levels(levels, model.drawn(levels, 0), model)  # noqa: E731
        numpy = lambda: [(level.readings.mean(0), level.readings.var(0)) for level in levels]  # noqa: E731
        return timed(compare, time.process_time) / timed(numpy, time.process_time)


def line(name: str, values: list[float]) -> None:
    print(f"{name:>34}" + "".join(f"{value:8.3g}" for value in values), flush=True)


if __name__ == "__main__":
    line("mean counts", list(IDEAL_COUNTS))
    line("ideal, poisson", [frames_over_poisson("ideal", mean) for mean in IDEAL_COUNTS])
    line("mean counts", list(MEAN_COUNTS))
    line("spadcam, moments, in draws", [moments_in_draws("spadcam", m) for m in MEAN_COUNTS])
    for name in ("ideal", "spadcam"):
        line(f"{name}, poisson", [frames_over_poisson(name, mean) for mean in MEAN_COUNTS])
        line(f"{name}, floor", [frames_over_floor(name, mean) for mean in MEAN_COUNTS])
    line("spadcam, by event", [frames_by_event("spadcam", mean) for mean in MEAN_COUNTS])
    for name in ("imx900-high-gain", "ixon-888"):
        electrons = (0.01, 1, 10, 100, 1000)
        line(f"frame cameras, {name}", [cameras_over_numpy(name, mean) for mean in electrons])
    traps = Afterpulsing(mean_carriers=0.1, delay_s=1e-5)
    line(
        "with afterpulsing, by event",
        [frames_by_event("spadcam", mean, afterpulsing=traps) for mean in MEAN_COUNTS],
    )
    binary = np.transpose([binary_over_binomial(p) for p in (0.02, 0.2, 0.6)])
    for name, values in zip(
        (
            "binary, binomial (p .02 .2 .6)",
            "rates to packed frames, binomial",
            "rates to packed frames, comparison",
            "binary, floor",
            "rates to packed frames, floor",
        ),
        binary,
        strict=True,
    ):
        line(name, list(values))
    line("compared, mean and variance", [comparison_over_numpy()])
    line("stored, hdf5: bytes, ns, plain files", stored_event())
    line("calibrated, mean and variance", [calibrated_over_numpy()])
    line(
        "radiance to counts, ideal, spadcam",
        [scene_over_poisson(name) for name in ("ideal", "spadcam")],
    )
    line(
        "two threads, the same and binary",
        [*(two_threads(name) for name in ("ideal", "spadcam")), two_threads_binary()],
    )
