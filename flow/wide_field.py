"""Wide-field integration: the camera's rotation rate as a weighted sum of local answers.

A fly's tangential cells add up local motion detectors over the eye, weighted as the flow of one
motion would excite them (Krapp and Hengstenberg 1996; Franz and Krapp 2000). Here the weights are
learned from a sequence whose rotation rate ω(t) is known. Least squares gives the slope of each
local answer r_i over the rate, and what is left is its noise:

    r_i = f_i·ω + noise     f_i = Σ_t r_i·ω / Σ_t ω²     σ_i² = mean of (r_i − f_i·ω)²

The matched filter weighs each answer by its slope over its variance, so that the sum has no bias
and, for noise that is independent between places, the smallest variance:

    ω̂ = Σ_i w_i·r_i / Σ_i w_i·f_i      w_i = f_i/σ_i²      var(ω̂) = 1 / Σ_i f_i²/σ_i²

Sums run over the answers that are defined at the time. Units: ω̂ has those of the rates that were
given (deg/s, say), f those of the answers per unit of rate (px per frame per deg/s), and w_i/Σ w·f
turns an answer into a rate. For velocities f follows from optics and frame rate alone; correlation
detectors depend on contrast and spatial frequencies too, so what they learned in one scene holds
for scenes like it. There is no constant term: standstill should be answered with 0. Where that is
in doubt learn from rates of both signs; at a single rate a constant answer passes for rotation.
"""

from dataclasses import dataclass

import numpy as np

from megalopta.flow.detector import FloatArray

_SHARED = 0.5
"""How far a variance is drawn to the median of all places: a few frames cannot tell a quiet place
from a lucky one, and none is free of noise."""


@dataclass(frozen=True)
class WideField:
    """A matched filter for a rotation rate; see `fit_wide_field`."""

    slopes: FloatArray
    """f: local answers per unit of rate, of the shape of one frame's answers"""

    weights: FloatArray
    """w = f/σ²; 0 where an answer was undefined throughout"""

    def rates(self, answers: FloatArray) -> FloatArray:
        """Return the rotation rate at each time, (T,); NaN when no answer is defined.

        Parameters
        ----------
        answers : (T, ...)
            From the detector that the filter was fitted to, on the same frame size.

        Raises
        ------
        ValueError
            When they have another shape than those of the fit.
        """
        if answers.shape[1:] != self.slopes.shape:
            raise ValueError(
                f"answers of shape {answers.shape}: the filter was fitted to (T,"
                f" {', '.join(map(str, self.slopes.shape))})"
            )
        flat, weights = answers.reshape(len(answers), -1), self.weights.ravel()
        sums = np.where(np.isfinite(flat), flat, 0) @ weights
        normalizations = np.isfinite(flat) @ (weights * self.slopes.ravel())
        with np.errstate(invalid="ignore"):  # 0/0 where none is defined
            return np.asarray(sums / normalizations)

    @property
    def standard_error(self) -> float:
        """Standard deviation of a rate (unit of the rates), if the noise stays that of the fit."""
        return float(1 / np.sqrt(np.sum(self.weights * self.slopes)))


def fit_wide_field(answers: FloatArray, rates: FloatArray) -> WideField:
    """Return the matched filter learned from answers to a known rotation.

    Parameters
    ----------
    answers : (T, ...)
        Responses (T, H, W) or velocities (T − 1, rows, columns, 2) of one detector; NaN where
        undefined.
    rates : (T,)
        Rotation rate at the same times, in any unit.

    Raises
    ------
    ValueError
        When the two differ in length, the rates are all 0, or no answer depends on them.
    """
    if rates.shape != answers.shape[:1]:
        raise ValueError(f"rates of shape {rates.shape} for {len(answers)} answers: give one each")
    omega = rates.reshape(-1, *[1] * (answers.ndim - 1))
    known = np.isfinite(answers)
    power = np.sum(omega**2 * known, axis=0)
    if not np.any(power > 0):
        raise ValueError("no answer is defined while the camera turns: give rates other than 0")
    filled = np.where(known, answers, 0)
    slopes = np.divide(
        np.sum(filled * omega, axis=0), power, out=np.zeros_like(power), where=power > 0
    )
    squares = np.sum(np.where(known, answers - slopes * omega, 0) ** 2, axis=0)
    variances = squares / np.maximum(known.sum(axis=0), 1)
    typical = float(np.median(variances[power > 0]) or variances.mean()) or 1.0
    noise = _SHARED * typical + (1 - _SHARED) * variances
    if not np.any(slopes):
        raise ValueError("no answer depends on the rate: take another detector")
    return WideField(slopes, slopes / noise)
