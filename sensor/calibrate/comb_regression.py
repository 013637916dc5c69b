"""Parameters of each pixel, and the slope of all, where numbers of events have their weights."""

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.sensor.calibrate.comb_readings import CombState, Readings
from megalopta.sensor.calibrate.least_squares import (
    columns_of,
    influence_of_slope,
    normal_matrix,
    residuals,
    right_side,
    unit_diagonal,
)

_DETERMINED = 1e-9
_OF_MEDIAN = 1.2533
"""Standard error of a median over that of a mean."""
_SLOPE_TOLD = 0.02
"""Standard error of the slope from which on it is told."""


def regressed(readings: Readings, weights: Floats, numbers: Floats, state: CombState) -> CombState:
    """Least squares of each pixel, residual noise, and the slope of all."""
    weights = weights * (numbers >= readings.fewest)
    columns = columns_of(readings, numbers, state)[:3]
    normal = normal_matrix(readings, weights, columns)
    right = right_side(readings, weights, columns)
    unit, scale = unit_diagonal(normal)
    regular = np.linalg.cond(unit) < 1e12
    found = np.einsum("pij,pj->pi", np.linalg.pinv(unit, hermitian=True), right / scale) / scale
    squares = readings.sums((weights * residuals(readings, columns, found) ** 2).sum(axis=0))
    frames = np.maximum(readings.sums(weights.sum(axis=0)) - 3, 1)
    state = state._replace(
        solution=np.where(regular[:, None], found, state.solution),
        noise=np.sqrt(np.maximum(squares / frames, 1e-18)),
    )
    return _sloped(readings, weights, numbers, state, regular) if state.may_slope else state


def _sloped(
    readings: Readings,
    weights: Floats,
    numbers: Floats,
    state: CombState,
    regular: NDArray[np.bool_],
) -> CombState:
    """Move the slope by what residuals have in common with the bend of the curve."""
    columns = columns_of(readings, numbers, state)
    information = normal_matrix(readings, weights, columns) / state.noise[:, None, None] ** 2
    residual = residuals(readings, columns[:3], state.solution)
    score = readings.sums((weights * columns[3] * residual).sum(axis=0)) / state.noise**2
    influence = influence_of_slope(information)
    left = information[:, 3, 3] - np.einsum("pi,pi->p", information[:, 3, :3], influence)
    told = regular & (left > _DETERMINED * information[:, 3, 3])
    error = _OF_MEDIAN / np.sqrt(max(float(left[told].sum()), 1e-30))
    if error > _SLOPE_TOLD:
        return state
    before = state.curve.slope
    slope = float(np.clip(before + _median(score[told] / left[told], left[told]), -1, 1))
    # elsewhere the first step stays what it was
    first = np.zeros_like(influence)
    first[:, 2] = state.solution[:, 2] / (2 + slope)
    moved = np.where(told[:, None], influence, first)
    return state._replace(
        solution=state.solution - (slope - before) * moved,
        curve=state.curve._replace(slope=slope),
        slope_error=float(error),
    )


def _median(values: Floats, weights: Floats) -> float:
    """Of weighted values; a pixel whose teeth are miscounted does not move it."""
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order[np.searchsorted(total, total[-1] / 2)]])
