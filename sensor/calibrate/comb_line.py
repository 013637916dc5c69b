"""The line that readings of a comb lie on, whose numbers of events are known by chance only.

Offset, leak and step of each pixel by weighted least squares, and the information on them.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.arrays import Floats
from megalopta.sensor.calibrate.level import Falls


class Readings(NamedTuple):
    """How often each pixel showed each fall, (E,)."""

    level: NDArray[np.int64]
    pixel: NDArray[np.int64]
    fall: Floats
    times: Floats
    exposure: Floats
    pixels: int
    fewest: int
    """Readings of fewer events are left out of the line."""

    @classmethod
    def of(cls, falls: Falls, exposure_s: Floats) -> "Readings":
        """Of all levels, with the exposure of each."""
        return cls(
            falls.level,
            falls.pixel,
            falls.fall_v,
            falls.times,
            exposure_s[falls.level],
            falls.frames.shape[1],
            int(falls.is_cut),
        )

    def at(self, chosen: NDArray[np.bool_]) -> "Readings":
        """Some of the readings."""
        names = "level", "pixel", "fall", "times", "exposure"
        return self._replace(**{name: getattr(self, name)[chosen] for name in names})

    def above(self, solution: Floats) -> tuple[Floats, Floats]:
        """What of each fall neither offset nor leak explain, and the step of its pixel, (E,)."""
        offset, leak, step = solution[self.pixel].T
        return self.fall - offset - leak * self.exposure, step

    def sums(self, values: Floats) -> Floats:
        """Sum of values (E,) over the readings of each pixel, (P,)."""
        return np.bincount(self.pixel, self.times * values, self.pixels).astype(np.float64)


def regression(
    readings: Readings, weights: Floats, numbers: Floats
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Least squares of each pixel, residual noise, and where the line is determined."""
    weights = weights * (numbers >= readings.fewest)
    normal, right = _normal_equations(readings, weights, numbers)
    scaled, scale = _scaled(normal)
    regular = np.linalg.cond(scaled) < 1e12
    solution = np.einsum("pij,pj->pi", np.linalg.pinv(scaled, hermitian=True), right / scale)
    solution = solution / scale
    fall, step = readings.above(solution)
    residual = fall - step * numbers
    squares = readings.sums((weights * residual**2).sum(axis=0))
    frames = np.maximum(readings.sums(weights.sum(axis=0)) - 3, 1)
    return solution, np.sqrt(np.maximum(squares / frames, 1e-18)), regular


def _normal_equations(
    readings: Readings, weights: Floats, numbers: Floats
) -> tuple[Floats, Floats]:
    T, y = readings.exposure, readings.fall
    zeroth, first, second = ((weights * numbers**power).sum(axis=0) for power in range(3))
    normal = np.empty((readings.pixels, 3, 3))
    for (row, column), values in {
        (0, 0): zeroth,
        (0, 1): T * zeroth,
        (0, 2): first,
        (1, 1): T**2 * zeroth,
        (1, 2): T * first,
        (2, 2): second,
    }.items():
        normal[:, row, column] = normal[:, column, row] = readings.sums(values)
    right = np.stack(
        [readings.sums(each) for each in (y * zeroth, T * y * zeroth, first * y)], axis=-1
    )
    return normal, right


def _scaled(normal: Floats) -> tuple[Floats, Floats]:
    scale = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-30))
    return normal / scale[:, :, None] / scale[:, None, :], scale


def covariance_of(
    readings: Readings, weights: Floats, numbers: Floats, solution: Floats, noise: Floats
) -> Floats:
    """Inverse of the observed information."""
    used = weights * (numbers >= readings.fewest)
    complete = _normal_equations(readings, used, numbers)[0] / noise[:, None, None] ** 2
    fall, step = readings.above(solution)
    residual = fall - step * numbers
    if len(weights) == 1:
        missing = 0 * complete
    else:
        missing = _missing(readings, weights, numbers, residual / noise[readings.pixel] ** 2)
    scaled, scale = _scaled(complete - missing)
    inverse = np.linalg.pinv(scaled, hermitian=True)
    return np.asarray(inverse / scale[:, :, None] / scale[:, None, :])


def _missing(readings: Readings, weights: Floats, numbers: Floats, pull: Floats) -> Floats:
    """Information that is missing because numbers of events are not known, (P, 3, 3)."""
    one = np.ones_like(numbers)
    regressors = np.stack([one, one * readings.exposure, numbers])
    scores = regressors * pull * (numbers >= readings.fewest)
    mean = (weights * scores).sum(axis=1)
    missing = np.empty((readings.pixels, 3, 3))
    for row in range(3):
        for column in range(3):
            product = (weights * scores[row] * scores[column]).sum(0) - mean[row] * mean[column]
            missing[:, row, column] = readings.sums(product)
    return missing
