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
    pixels = width * height
    at_once = _largest_divisor(samples, max(1, SAMPLES_AT_ONCE // pixels))
    sampler = sensor.sampler()
    sampler.set_samples_per_wavefront(at_once)
    sampler.seed(seed, pixels * at_once)
    total: list[Any] = []
    for first in range(0, samples, at_once):
        lane = dr.arange(mi.UInt, pixels * at_once)
        pixel = lane // at_once
        corner = mi.Point2f(pixel % width, pixel // width)
        place = (mi.Float(lane - pixel * at_once + first) + 0.5) / samples
        position = (corner + sampler.next_2d()) / mi.Point2f(width, height)
        time = sampler.next_1d() if sensor.shutter_open_time() > 0 else mi.Float(0.0)
        ray, _ = sensor.sample_ray(time, 0.5, position, mi.Point2f(0.5))
        found = [dr.block_sum(each, at_once) / samples for each in look(ray, place, sampler)]
        total = [a + b for a, b in zip(total, found, strict=True)] if total else found
        sampler.advance()
        sampler.schedule_state()
        dr.eval(total)
    stacked = np.stack([np.array(values) for values in total], axis=-1)
    return stacked.reshape(height, width, len(total))


def _largest_divisor(number: int, limit: int) -> int:
    return max(each for each in range(1, min(number, limit) + 1) if number % each == 0)
