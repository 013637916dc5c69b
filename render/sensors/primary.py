"""Means over pixels of whatever is found along a sensor's rays; in vectorized variants."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render import dr, mi

# Samples traced at once: what they found is held until it is summed.
SAMPLES_AT_ONCE = 2**22

Look = Callable[[Any, Any, Any], list[Any]]
"""What rays find, a list of floats each, given rays, the place from 0 to 1 of each sample among
those of its pixel, and the sampler, which has more random numbers for them."""


def pixel_means(sensor: Any, seed: int, samples: int, look: Look) -> NDArray[np.float32]:
    """Means (H, W, n) over the samples of each pixel."""
    width, height = (int(size) for size in sensor.film().crop_size())
    means = _means(sensor, sensor.sampler(), seed, samples, width * height, lambda lane: lane, look)
    return means.reshape(height, width, -1)


def means_of_pixels(
    sensor: Any, seed: int, samples: int, pixels: NDArray[np.integer], look: Look
) -> NDArray[np.float32]:
    """Means (P, n) over the multijittered samples of some pixels (P,), counted row by row."""
    sampler: Any = mi.load_dict({"type": "multijitter", "sample_count": samples})
    table = mi.UInt(pixels.astype(np.uint32))
    return _means(
        sensor, sampler, seed, samples, len(pixels), lambda n: dr.gather(mi.UInt, table, n), look
    )


def _means(
    sensor: Any,
    sampler: Any,
    seed: int,
    samples: int,
    pixels: int,
    pixel_of: Callable[[Any], Any],
    look: Look,
) -> NDArray[np.float32]:
    """Means (pixels, n); `pixel_of` takes a number below `pixels` to the pixel that it means."""
    width, height = (int(size) for size in sensor.film().crop_size())
    at_once = _largest_divisor(samples, max(1, SAMPLES_AT_ONCE // pixels))
    sampler.set_samples_per_wavefront(at_once)
    sampler.seed(seed, pixels * at_once)
    total: list[Any] = []
    for first in range(0, samples, at_once):
        lane = dr.arange(mi.UInt, pixels * at_once)
        number = lane // at_once
        pixel = pixel_of(number)
        corner = mi.Point2f(pixel % width, pixel // width)
        place = (mi.Float(lane - number * at_once + first) + 0.5) / samples
        position = (corner + sampler.next_2d()) / mi.Point2f(width, height)
        time = sampler.next_1d() if sensor.shutter_open_time() > 0 else mi.Float(0.0)
        ray, _ = sensor.sample_ray(time, 0.5, position, mi.Point2f(0.5))
        found = [dr.block_sum(each, at_once) / samples for each in look(ray, place, sampler)]
        total = [a + b for a, b in zip(total, found, strict=True)] if total else found
        sampler.advance()
        sampler.schedule_state()
        dr.eval(total)
    return np.stack([np.array(values) for values in total], axis=-1)


def _largest_divisor(number: int, limit: int) -> int:
    return max(each for each in range(1, min(number, limit) + 1) if number % each == 0)
