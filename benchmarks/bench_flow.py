"""Block matching against its NumPy form and against drawing; correlation detectors against drawing.

One thread, medians, reference and subject in the same run.
`numpy_block_matching` is also the independent implementation that the tests compare with.
"""

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from megalopta.core.arrays import Floats
from megalopta.flow.detectors.registry import method
from megalopta.flow.stimuli.photons import draw_counts

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


if __name__ == "__main__":
    for size in (60, 240):
        compare(size)
