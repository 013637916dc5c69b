"""Means over pixels of quantities along a sensor's rays; in vectorized variants."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render import dr, mi

# Samples traced at once: their results are held until they are summed.
SAMPLES_AT_ONCE = 2**22

_COALESCED = 4
"""Samples of a pixel summed by Mitsuba before they are written to the image."""

Look = Callable[[Any, Any, Any], list[Any]]
"""Quantities along rays, a list of floats each, given rays, the place from 0 to 1 of each sample
among those of its pixel, and the sampler, which has more random numbers for them."""


Radiance = Callable[[Any, Any], tuple[Any, Any]]
"""Spectral radiance along rays, given a sampler and these, and True for those with a hit."""


def developed(sensor: Any, seed: int, samples: int, radiance: Radiance) -> NDArray[np.float32]:
    """Image (H, W, B) of a sensor with a box filter, equal to the last bit to that of `mi.render`.

    Rays are computed before their radiance, so the compiled path tracer depends neither on the
    image's size nor on the sensor.
    """
    film, sampler = sensor.film(), sensor.sampler()
    width, height = (int(size) for size in film.crop_size())
    film.prepare([])
    sampler.set_samples_per_wavefront(samples)
    sampler.seed(seed, width * height * samples)
    pixel = dr.arange(mi.UInt, width * height * samples) // dr.opaque(mi.UInt, samples)
    corner = mi.Point2f(pixel % width, pixel // width)
    position = (corner + sampler.next_2d()) * mi.Point2f(1 / width, 1 / height)
    aperture = sampler.next_2d() if sensor.needs_aperture_sample() else mi.Point2f(0.5)
    time = sampler.next_1d() if sensor.shutter_open_time() > 0 else mi.Float(0.0)
    rays, weight = sensor.sample_ray_differential(time, sampler.next_1d(), position, aperture)
    sampler.schedule_state()
    dr.eval(rays, weight)
    light, valid = radiance(sampler, rays)
    block = film.create_block()
    block.set_coalesce(block.coalesce() and samples >= _COALESCED)
    block.put(
        corner,
        film.prepare_sample(
            light * weight, rays.wavelengths, block.channel_count(),
            alpha=dr.select(valid, mi.Float(1), mi.Float(0)),
        ),
    )  # fmt: skip
    film.put_block(block)
    return np.array(film.develop(), np.float32)


def pixel_means(
    sensor: Any, sampler: Any, seed: int, look: Look, chosen: NDArray[np.integer] | None = None
) -> NDArray[np.float32]:
    """Means (H, W, n) over as many samples of each pixel as the sampler has.

    With chosen pixels (P,), counted row by row: (P, n).
    """
    width, height = (int(size) for size in sensor.film().crop_size())
    samples, pixels, table = int(sampler.sample_count()), width * height, None
    if chosen is not None:
        pixels, table = len(chosen), mi.UInt(chosen.astype(np.uint32))
    most = min(samples, max(1, SAMPLES_AT_ONCE // pixels))
    at_once = max(each for each in range(1, most + 1) if samples % each == 0)
    sampler.set_samples_per_wavefront(at_once)
    sampler.seed(seed, pixels * at_once)
    # As constants they would have the same code compiled for each image size.
    columns, each_time, in_all = (dr.opaque(mi.UInt, x) for x in (width, at_once, samples))
    size = mi.Point2f(columns, dr.opaque(mi.UInt, height))
    total: list[Any] = []
    for first in range(0, samples, at_once):
        lane = dr.arange(mi.UInt, pixels * at_once)
        number = lane // each_time
        pixel = number if table is None else dr.gather(mi.UInt, table, number)
        corner = mi.Point2f(pixel % columns, pixel // columns)
        index = lane - number * each_time + dr.opaque(mi.UInt, first)
        place = (mi.Float(index) + 0.5) / mi.Float(in_all)
        position = (corner + sampler.next_2d()) / size
        time = sampler.next_1d() if sensor.shutter_open_time() > 0 else mi.Float(0.0)
        ray, _ = sensor.sample_ray(time, 0.5, position, mi.Point2f(0.5))
        sampler.schedule_state()
        dr.eval(ray, place)  # so that what is looked at does not depend on the camera
        seen = look(ray, place, sampler)
        dr.eval(seen)  # otherwise rays would be traced again for each quantity
        found = [dr.block_sum(each, at_once) / samples for each in seen]
        total = [a + b for a, b in zip(total, found, strict=True)] if total else found
        sampler.advance()
        sampler.schedule_state()
        dr.eval(total)
    means = np.stack([np.array(values) for values in total], axis=-1)
    return means if table is not None else means.reshape(height, width, -1)
