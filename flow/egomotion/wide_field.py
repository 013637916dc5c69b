"""Wide-field integration: the camera's rotation rate as a weighted sum of local answers.

A fly's tangential cells add up local motion detectors over the eye, weighted as the flow of one
motion would excite them (Krapp and Hengstenberg 1996; Franz and Krapp 2000). Here the weights are
learned from a sequence whose rotation rate ω(t) is known. Least squares gives the slope of each
local answer r_i over the rate, and what is left is its noise:

    r_i = f_i·ω + noise     f_i = Σ_t r_i·ω / Σ_t ω²     σ_i² = mean of (r_i − f_i·ω)²

The matched filter weighs each answer by its slope over its variance. Slopes are noisy, and the
square of a noisy slope is too large: it is taken as the product of the slopes f_a and f_b of the
first and the second half of the sequence, so that the sum is not drawn to zero,

    ω̂ = Σ_i w_i·r_i / Σ_i q_i      w_i = (f_a + f_b)/2σ_i²      q_i = f_a·f_b/σ_i²

    var(ω̂) = Σ_i w_i²·σ_i² / (Σ_i q_i)²

for noise that is independent between places and times; with many frames to learn from it is the
least possible, 1/Σ f_i²/σ_i².

Sums run over the answers that are defined at the time. Units: ω̂ has those of the rates that were
given (deg/s, say), f those of the answers per unit of rate (px per frame per deg/s), and w_i/Σ q
turns an answer into a rate. For velocities f follows from optics and frame rate alone; correlation
detectors depend on contrast and spatial frequencies too, so what they learned in one scene holds
for scenes like it. There is no constant term: standstill should be answered with 0. Where that is
in doubt learn from rates of both signs; at a single rate a constant answer passes for rotation.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from megalopta.flow.detectors import FloatArray

_SHARED = 0.5
"""How far a variance is drawn to the median of all places: a few frames cannot tell a quiet place
from a lucky one, and none is free of noise."""


@dataclass(frozen=True)
class WideField:
    """A matched filter for a rotation rate; see `fit_wide_field`."""

    slopes: FloatArray
    """f: local answers per unit of rate, of the shape of one frame's answers"""

    weights: FloatArray
    """w; 0 where an answer was undefined throughout a half"""

    squared_snr: FloatArray
    """q: squared signal-to-noise ratio of an answer at a rate of 1"""

    standard_error: float
    """Standard deviation of a rate (unit of the rates), if the noise stays that of the fit"""

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
        normalizations = np.isfinite(flat) @ self.squared_snr.ravel()
        with np.errstate(invalid="ignore"):  # 0/0 where none is defined
            return np.asarray(sums / normalizations)


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
        When the two differ in length, the rates are all 0 in one half, or no answer depends on
        them beyond its noise.
    """
    if rates.shape != answers.shape[:1]:
        raise ValueError(f"rates of shape {rates.shape} for {len(answers)} answers: give one each")
    halves = [slice(None, len(rates) // 2), slice(len(rates) // 2, None)]
    (first, known_first), (second, known_second) = (
        _slopes(answers[half], rates[half]) for half in halves
    )
    slopes, _ = _slopes(answers, rates)
    known = known_first & known_second
    if not known.any():
        raise ValueError(
            "no answer is defined while the camera turns, in both halves of the sequence: give"
            " rates other than 0"
        )
    noise = _noise(answers, slopes, rates, known)
    weights = np.where(known, (first + second) / 2, 0) / noise
    squared_snr = np.where(known, first * second, 0) / noise
    total = float(squared_snr.sum())
    if total <= 0:
        raise ValueError(
            "no answer depends on the rate, beyond its noise: take another detector, or learn from"
            " more frames"
        )
    error = float(np.sqrt(np.sum(weights**2 * noise))) / total
    return WideField(slopes, weights, squared_snr, error)


def _slopes(answers: FloatArray, rates: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return the slope of each answer over the rate, 0 where it is unknown, and where it is not."""
    omega = rates.reshape(-1, *[1] * (answers.ndim - 1))
    defined = np.isfinite(answers)
    power = np.sum(omega**2 * defined, axis=0)
    sums = np.sum(np.where(defined, answers, 0) * omega, axis=0)
    return np.divide(sums, power, out=np.zeros_like(power), where=power > 0), power > 0


def _noise(
    answers: FloatArray, slopes: FloatArray, rates: FloatArray, known: NDArray[np.bool_]
) -> FloatArray:
    """Return the variance of each answer about its slope, drawn to that of the median place."""
    omega = rates.reshape(-1, *[1] * (answers.ndim - 1))
    defined = np.isfinite(answers)
    squares = np.sum(np.where(defined, answers - slopes * omega, 0) ** 2, axis=0)
    variances = squares / np.maximum(defined.sum(axis=0), 1)
    typical = float(np.median(variances[known]) or variances.mean()) or 1.0
    return np.asarray(_SHARED * typical + (1 - _SHARED) * variances)
