"""Weighted least squares of each pixel: offset, leak and step, and the slope of all beside them.

Weights and numbers of events are (k, E): of each reading, k numbers that it may stand for.
"""

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.sensor.calibrate.comb_readings import CombState, Readings


def columns_of(readings: Readings, numbers: Floats, state: CombState) -> list[Floats]:
    """Derivatives of readings by offset, leak, step and slope, each (…, E)."""
    step = state.solution[readings.pixel, 2]
    one = np.ones_like(numbers)
    steps, bend = state.curve.steps(numbers, step), state.curve.bend(numbers, step)
    return [one, one * readings.exposure, steps, step * bend]


def residuals(readings: Readings, columns: list[Floats], solution: Floats) -> Floats:
    """What of each fall the columns do not explain."""
    parts = zip(columns, solution[readings.pixel].T, strict=True)
    return np.asarray(readings.fall - sum(column * value for column, value in parts))


def normal_matrix(readings: Readings, weights: Floats, columns: list[Floats]) -> Floats:
    """Matrix of the normal equations of each pixel."""
    normal = np.empty((readings.pixels, len(columns), len(columns)))
    for row, one in enumerate(columns):
        for column, other in enumerate(columns[: row + 1]):
            product = readings.sums((weights * one * other).sum(axis=0))
            normal[:, row, column] = normal[:, column, row] = product
    return normal


def right_side(readings: Readings, weights: Floats, columns: list[Floats]) -> Floats:
    """Right side of the normal equations of each pixel."""
    sums = [readings.sums((weights * each * readings.fall).sum(axis=0)) for each in columns]
    return np.stack(sums, axis=-1)


def unit_diagonal(normal: Floats) -> tuple[Floats, Floats]:
    """Matrices with a diagonal of ones, and what their rows and columns were divided by."""
    scale = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-30))
    return normal / scale[:, :, None] / scale[:, None, :], scale


def influence_of_slope(information: Floats) -> Floats:
    """How far the three parameters of a pixel move with the slope, (P, 3), with opposite sign."""
    unit, scale = unit_diagonal(information[:, :3, :3])
    inverse = np.linalg.pinv(unit, hermitian=True)
    return np.asarray(np.einsum("pij,pj->pi", inverse, information[:, :3, 3] / scale) / scale)
