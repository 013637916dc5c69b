"""Errors of the parameters: from the information of the readings, less that which is missing."""

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.sensor.calibrate.comb_readings import CombState, Readings
from megalopta.sensor.calibrate.least_squares import (
    columns_of,
    influence_of_slope,
    normal_matrix,
    residuals,
    unit_diagonal,
)


def covariance_of(readings: Readings, weights: Floats, numbers: Floats, state: CombState) -> Floats:
    """Inverse of the observed information, and what the error of the slope adds."""
    used = weights * (numbers >= readings.fewest)
    columns = columns_of(readings, numbers, state)
    complete = normal_matrix(readings, used, columns) / state.noise[:, None, None] ** 2
    information = complete[:, :3, :3]
    if len(weights) > 1:
        pull = residuals(readings, columns[:3], state.solution) / state.noise[readings.pixel] ** 2
        information = information - _missing(readings, weights, columns[:3], pull * (used > 0))
    unit, scale = unit_diagonal(information)
    inverse = np.linalg.pinv(unit, hermitian=True)
    covariance = inverse / scale[:, :, None] / scale[:, None, :]
    if np.isfinite(state.slope_error):
        moved = state.slope_error * influence_of_slope(complete)
        covariance = covariance + moved[:, :, None] * moved[:, None, :]
    return np.asarray(covariance)


def _missing(readings: Readings, weights: Floats, columns: list[Floats], pull: Floats) -> Floats:
    """Information that is missing because numbers of events are not known, (P, 3, 3)."""
    scores = np.stack(columns) * pull
    mean = (weights * scores).sum(axis=1)
    missing = np.empty((readings.pixels, 3, 3))
    for row in range(3):
        for column in range(3):
            product = (weights * scores[row] * scores[column]).sum(0) - mean[row] * mean[column]
            missing[:, row, column] = readings.sums(product)
    return missing
