"""Block matching against its NumPy form and against drawing; correlation detectors against drawing.

One thread, medians, reference and subject in the same run. Of some trials of Chapter 4, where the
time goes, and how far drawing photons is from its floor: a normal number for each count, and means
read from memory. Last, how long the quick form of the chapter takes, start-up included.
`numpy_block_matching` is also the independent implementation that the tests compare with.
"""

import cProfile
import pstats
import statistics
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from megalopta.benchmark.trial import Trial, measure_trial, template_pixels
from megalopta.core.arrays import Floats
from megalopta.flow import benchmark_search
from megalopta.flow.detectors.registry import method
from megalopta.flow.stimuli.photons import draw_counts, draw_in_one
from megalopta.reproduction.chapter4 import FIGURES, sweep
from megalopta.sensor.sampling.streams import EDGES, LANES, fill_normals, word_streams

FRAMES = 16


def numpy_block_matching(
    reference: NDArray[Any], current: NDArray[Any], block: int, radius: int
) -> Floats:
    """One velocity (x, y) per block by whole-frame differences, one per candidate shift."""
    height, width = current.shape
    blocks = (height // block, block, width // block, block)
    padded = np.pad(reference.astype(float), radius, constant_values=np.nan)
    best = np.full(blocks[::2], np.inf)
    velocity = np.zeros((*blocks[::2], 2))
    for dy in range(2 * radius + 1):
        for dx in range(2 * radius + 1):
            shifted = padded[dy : dy + height, dx : dx + width]
            cost = np.abs(current - shifted).reshape(blocks).sum(axis=(1, 3))
            better = cost < best
            best[better] = cost[better]
            velocity[better] = (radius - dx, radius - dy)
    return velocity


def moving_texture(size: int, step: int) -> Floats:
    """Smoothed noise that moves `step` px per frame to the right, (FRAMES, size, size)."""
    noise = np.random.default_rng(1).random((size, size + step * FRAMES))
    texture = gaussian_filter(noise, 2)
    texture = (texture - texture.min()) / np.ptp(texture)
    starts = [step * (FRAMES - 1 - t) for t in range(FRAMES)]
    return np.stack([texture[:, start : start + size] for start in starts])


def milliseconds_per_frame(run: Callable[[], object]) -> float:
    run()
    times = []
    for _ in range(7):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return 1e3 * statistics.median(times) / FRAMES


def compare(size: int) -> None:
    rng = np.random.default_rng(0)
    means = 20 * moving_texture(size, 3)
    counts = rng.poisson(means).astype(np.uint16)
    block, radius = size // 10, round((75 + size) / 45)

    def all_pairs() -> None:
        for pair in range(FRAMES - 1):
            numpy_block_matching(counts[pair], counts[pair + 1], block, radius)

    drawing = milliseconds_per_frame(lambda: rng.poisson(means))
    in_numpy = milliseconds_per_frame(all_pairs)
    print(f"{size} × {size} px, {means.mean():.0f} photons per pixel and frame")
    ours = milliseconds_per_frame(lambda: draw_counts(means, 0))
    print(f"  drawing photons (Generator.poisson)  {drawing:8.3f} ms per frame")
    print(f"  drawing photons (draw_counts)        {ours:8.3f} ms, {drawing / ours:.1f} × as fast")
    print(f"  block matching in NumPy              {in_numpy:8.3f} ms per frame")
    correlators = 0.0
    for name in ("BM", "IIA", "EMD", "NDM", "NDS"):
        detector = method(name)
        spent = milliseconds_per_frame(lambda detector=detector: detector.respond(counts, 0.1))
        correlators += spent if detector.gives == "response" else 0.0
        ratio = f", NumPy's time is {in_numpy / spent:.1f} × that" if name == "BM" else ""
        print(f"  {name:<37}{spent:8.3f} ms per frame, {spent / ours:.2f} × its draw{ratio}")
    print(f"  EMD + NDM + NDS: {correlators / drawing:.3f} × NumPy's draw of the same frame")


def chapter(every: int = 16) -> None:
    """Measure some trials of Chapter 4, and say where their time goes, and what the floor is."""
    trials = sorted({trial for name in FIGURES for trial in sweep(name).trials}, key=_size_first)
    some = trials[::every]
    pixels = template_pixels(each.template for each in some)
    measure_trial(some[0], pixels[some[0].template], "benchmark")  # compiles
    drawn = 0

    def counted(light: Floats, *arguments: Any, **more: Any) -> Any:
        nonlocal drawn
        drawn += light.size
        return draw_in_one(light, *arguments, **more)

    profile = cProfile.Profile(time.process_time)
    with patch.object(benchmark_search, "draw_in_one", counted), profile:
        for each in some:
            measure_trial(each, pixels[each.template], "benchmark")
    spent: Counter[str] = Counter()
    for (file, _, _), (_, _, own, _, _) in pstats.Stats(profile).stats.items():  # type: ignore[attr-defined]
        spent[next((what for part, what in _PARTS.items() if part in file), "the rest")] += own
    total = sum(spent.values())
    print(f"Chapter 4: {len(some)} of {len(trials)} trials, {total:.1f} s of CPU")
    for what, seconds in spent.most_common():
        print(f"  {what:<37}{seconds / total:6.0%}")
    floor, ours = floor_ns(), 1e9 * spent["drawing photons"] / drawn
    print(f"  a photon count takes {ours:.1f} ns; its floor {floor:.1f}")


def floor_ns() -> float:
    """Nanoseconds for a normal number and a mean that comes from memory."""
    streams, words = word_streams(np.random.default_rng(0), 2), np.empty((64, LANES), np.uint64)
    numbers, means = np.empty(words.size), np.ones(2**23)

    def run(work: Callable[[], object], size: int) -> float:
        work()
        start = time.process_time()
        for _ in range(2**24 // size):
            work()
        return (time.process_time() - start) * 1e9 / 2**24

    drawing = run(lambda: fill_normals(streams[0], streams[1], words, EDGES, numbers), words.size)
    return drawing + run(means.max, means.size)


def quick_form() -> None:
    """Time `megalopta reproduce chapter-4 --quick` as a whole."""
    command = [sys.executable, "-m", "megalopta", "reproduce", "chapter-4", "--quick", "--out"]
    times = []
    for _ in range(3):
        with TemporaryDirectory() as out:
            start = time.perf_counter()
            subprocess.run([*command, out], check=True, capture_output=True)
            times.append(time.perf_counter() - start)
    print(f"Chapter 4 in quick form: {statistics.median(times):.1f} s (required: 6)")


_PARTS = {
    "sensor/sampling": "drawing photons",
    "block_matching": "block matching",
    "correlation": "EMD, NDM, NDS",
    "image_interpolation": "image interpolation",
    "dufunc": "closed form of IM",
    "response_error": "errors",
}


def _size_first(trial: Trial) -> tuple[Any, ...]:
    return trial.size, trial.model_dump_json()


if __name__ == "__main__":
    for size in (60, 240):
        compare(size)
    chapter()
    quick_form()
