"""Light that is uneven over the array, more than the known device's efficiency lets expect.

Deviations of pixels under light, relative to their expected signal, are fitted by a smooth surface:
tilt and curvature in rows and columns, of mean 0. If it is seen in every lit recording alike, and
not in the dark, the light was uneven; an efficiency that changed smoothly would look the same. The
surface is subtracted, so that it is neither taken for a fault of lines nor of the device.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from megalopta.core.arrays import Floats, Mask
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.faults import Fault
from megalopta.sensor.compare.in_time import Parts
from megalopta.sensor.compare.pattern import Deviations, robust_fit

_CHI2 = 60.0
"""Limit of the chi-squared of five coefficients; chance exceeds it once in 1e11."""
_FEWEST = 50
_SMALLEST = 0.03
"""Smallest range over the array, relative."""


class Uneven(NamedTuple):
    """Uneven light."""

    surface: Floats
    """Light relative to its mean, less 1, (rows, columns)"""
    fault: Fault


def uneven_light(
    levels: Sequence[Level], found: Sequence[Deviations], good: Sequence[Mask],
    parts: Sequence[Parts],
) -> Uneven | None:  # fmt: skip
    """Return how uneven the light was, or None if nothing shows it."""
    lit = [at for at, level in enumerate(levels) if not level.is_dark]
    if not lit:
        return None
    shapes = _smooth(good[0].shape)
    columns = np.concatenate([shapes[good[at]] * parts[at].light[good[at]][:, None] for at in lit])
    values, sigma = (
        np.concatenate([each[good[at]] for at, each in zip(lit, maps, strict=True)])
        for maps in zip(*((found[at].counts, found[at].error) for at in lit), strict=True)
    )
    if len(values) < _FEWEST:
        return None
    solution = robust_fit(columns, values, sigma)
    surface = shapes @ solution
    span = float(np.ptp(surface))
    if np.sum((columns @ solution / sigma) ** 2) < _CHI2 or span < _SMALLEST:
        return None
    text = f"the light is uneven, by {100 * span:.2g} % over the array"
    return Uneven(surface, Fault("uneven light", text))


def _smooth(shape: tuple[int, ...]) -> Floats:
    """Tilts and curvatures of mean 0, (rows, columns, 5)."""
    y, x = (np.linspace(-1, 1, side) for side in shape)
    y, x = np.meshgrid(y, x, indexing="ij")
    each = np.stack((x, y, x * y, x**2, y**2), axis=-1)
    return np.asarray(each - each.mean(axis=(0, 1)))
