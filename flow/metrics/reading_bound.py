"""Information of a sensor's readings on motion, from their means and variances, without draws.

A displacement d of the light changes the mean readings m. Estimates that know how mean and variance
of a reading depend on the light (quasi-likelihood) have the information

    J = Σ ∇m·∇mᵀ/v

on d. With photons and dark counts alone it is the Fisher information, since then v = m. Otherwise
the Fisher information is at least J, whatever the distribution of the readings (Cauchy and
Schwarz). A saturated pixel has ∇m = 0 and tells nothing.

Crosstalk correlates neighbors. Where each avalanche fires p others, the total of the avalanches
that one photon causes has the mean 1/(1 − p) and, with photons of Poisson number, the variance
1/(1 − p)³ per photon: that of a sum over many pixels is 1/(1 − p)² times the sum of the variances
(Borel's distribution). Variances are taken times this, which holds for textures coarser than the
reach of crosstalk.

Assumptions: those of `translation_bound`, and a calibrated device, whose fixed pattern is known and
at rest.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

from megalopta.core.arrays import Floats
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.metrics.translation_bound import information_of, spline_gradient
from megalopta.sensor import Sensor, reading_moments
from megalopta.sensor.spad.device import draw_fixed_pattern

_STEP = 0.01
"""Share of the light by which slopes are found"""
_CONSTANT = 1e-10
"""Variance over squared mean below which a reading is constant, and its slope rounding"""
_PARTS_PER_PX = 2


class ReadingSlopes(NamedTuple):
    """Change of the readings with the displacement of the light, and their noise."""

    gradient: Floats
    """Gradient (2, H, W) of the mean readings along x and y, per px"""
    variance: Floats
    """Variance (H, W) of the readings; 0 where they are constant"""

    def of_blocks(self, grid: BlockGrid) -> Floats:
        """Return J of each block, (rows, columns, 2, 2), px⁻²."""
        return information_of(self.gradient, self.variance, grid)

    def of_turn(self, flow: Floats) -> float:
        """Return the information on one number that moves pixels by a flow (H, W, 2) per unit."""
        along = np.einsum("ayx,yxa->yx", self.gradient, flow)
        known = self.variance > 0
        return float(np.sum(along[known] ** 2 / self.variance[known]))


def reading_slopes(light_hz: Floats, sensor: Sensor) -> ReadingSlopes:
    """Return how a sensor's readings change with the displacement of the light.

    `light_hz` (H, W): photons per second that identical pixels detect (`detected_rate`); the
    differences of the sensor's pixels are added.
    """
    rows, columns = light_hz.shape
    rates = light_hz * draw_fixed_pattern(sensor, (rows, columns)).efficiency_factor
    mean, variance = reading_moments(np.stack(((1 - _STEP) * rates, (1 + _STEP) * rates)), sensor)
    steepness = np.zeros((2, rows, columns))
    np.divide(spline_gradient(light_hz), light_hz, out=steepness, where=light_hz > 0)
    noise = variance.mean(axis=0) / (1 - sensor.crosstalk.mean_fired_neighbors) ** 2
    varies = noise > _CONSTANT * mean.mean(axis=0) ** 2
    gradient = steepness * (mean[1] - mean[0]) / (2 * _STEP)
    return ReadingSlopes(gradient, np.where(varies, noise, 0.0))


def blurred_by_motion(light: Floats, way: Floats) -> Floats:
    """Return the mean of light (H, W) that moves along a straight way (H, W, 2), px.

    The way is centered on each pixel, and the light is the cubic spline through the pixels.
    """
    parts = math.ceil(_PARTS_PER_PX * float(np.hypot(*np.moveaxis(way, -1, 0)).max()))
    if not parts:
        return light
    coefficients, centers = spline_filter(light, mode="nearest"), np.indices(light.shape)
    times = (np.arange(parts + 1) + 0.5) / (parts + 1) - 0.5
    way_yx = np.moveaxis(way[..., ::-1], -1, 0)
    moved = [
        map_coordinates(coefficients, centers - time * way_yx, prefilter=False, mode="nearest")
        for time in times
    ]
    return np.asarray(np.mean(moved, axis=0)).clip(0)
