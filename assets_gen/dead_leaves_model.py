"""Dead leaves: opaque disks that fall on each other until they cover the ground.

With radii of density r⁻³ the image is scale-invariant and has the statistics of natural scenes that
matter to motion detectors: occlusion edges, large plain areas, a power-law spectrum (Lee, Mumford
and Huang, Int. J. Comput. Vision 41, 35, 2001). Disks are painted from front to back, so each
paints only bare parts.
"""

import math

import numpy as np

from megalopta.assets_gen import FloatArray
from megalopta.core.compiling import compiled

_SAMPLES = 3
"""Samples along a pixel, for edges as soft as those of a sensor's pixels"""


def dead_leaves(
    shape: tuple[int, int],
    rng: np.random.Generator,
    radii_px: tuple[float, float] = (1.5, 80.0),
    values: tuple[float, float] = (0.1, 1.0),
) -> FloatArray:
    """Return an image (H, W) of disks that tiles without a seam in both directions.

    Radii have density r⁻³ between the smallest and the largest, values are uniform between the
    darkest and the brightest. Raises ValueError if either are not in increasing order above 0, or a
    disk would be wider than the image.
    """
    for name, (low, high) in (("radii_px", radii_px), ("values", values)):
        if not 0 < low <= high:
            raise ValueError(f"{name} {low} … {high}: give two in increasing order, above 0")
    if 2 * radii_px[1] > min(shape):
        raise ValueError(
            f"radii_px up to {radii_px[1]}: the disks are wider than the image of {shape[0]} ×"
            f" {shape[1]} px; give at most half of its shorter side"
        )
    image = np.zeros((shape[0] * _SAMPLES, shape[1] * _SAMPLES))
    radii = float(radii_px[0] * _SAMPLES), float(radii_px[1] * _SAMPLES)
    _cover(image, rng, radii, (float(values[0]), float(values[1])))
    return np.asarray(image.reshape(shape[0], _SAMPLES, shape[1], _SAMPLES).mean(axis=(1, 3)))


@compiled
def _cover(
    image: FloatArray,
    rng: np.random.Generator,
    radii: tuple[float, float],
    values: tuple[float, float],
) -> None:
    """Paint leaves until nothing is bare."""
    (height, width), bare = image.shape, image.size
    most, least = radii[0] ** -2, radii[1] ** -2
    while bare:
        # the inverse of the cumulative distribution of r⁻³
        radius = (least + rng.random() * (most - least)) ** -0.5
        row, column = rng.random() * height, rng.random() * width
        value = values[0] + (values[1] - values[0]) * rng.random()
        bare -= paint_leaf(image, (row, column), radius, value)


@compiled
def paint_leaf(image: FloatArray, center: tuple[float, float], radius: float, value: float) -> int:
    """Paint the bare part (0) of a disk on a torus; return its number of samples."""
    (height, width), (row, column), painted = image.shape, center, 0
    # samples are at the centers of their squares
    for y in range(math.ceil(row - radius - 0.5), math.ceil(row + radius - 0.5)):
        for x in range(math.ceil(column - radius - 0.5), math.ceil(column + radius - 0.5)):
            seen = (y + 0.5 - row) ** 2 + (x + 0.5 - column) ** 2 < radius**2
            if seen and image[y % height, x % width] == 0:
                image[y % height, x % width] = value
                painted += 1
    return painted
