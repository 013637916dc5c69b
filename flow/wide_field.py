"""Wide-field integration: the camera's rotation rate as a weighted sum of local responses.

A fly's tangential cells sum local motion detectors over the eye, weighted by the flow of one
motion (Krapp and Hengstenberg 1996; Franz and Krapp 2000). Here the weights are
learned from a sequence whose rotation rate ω(t) is known. Least squares gives the slope of each
local response r_i over the rate; the residual is its noise:

    r_i = f_i·ω + noise     f_i = Σ_t r_i·ω / Σ_t ω²     σ_i² = mean of (r_i − f_i·ω)²

The matched filter weights each response by its slope over its variance. Slopes are noisy, and the
square of a noisy slope is too large: it is replaced by the product of the slopes f_a and f_b of
the first and the second half of the sequence, so that the sum is not biased toward zero,

    ω̂ = Σ_i w_i·r_i / Σ_i q_i      w_i = (f_a + f_b)/2σ_i²      q_i = f_a·f_b/σ_i²

    var(ω̂) = Σ_i w_i²·σ_i² / (Σ_i q_i)²

for noise that is independent between places and times. Sums run over the responses that are defined
at the time. There is no constant term: at a single rate a constant response looks like rotation.
For velocities f depends on optics and frame rate alone; correlation detectors also depend on
contrast and spatial frequencies, so their weights hold for similar scenes only.

The yaw rate of a sequence: the weights are learned from the noise-free responses to its first half,
and tested on the second half. Detectors that are blind to direction are excluded.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats
from megalopta.flow.detectors.base import Detector
from megalopta.scenes.trajectories.base import Path

_SHARED = 0.5
"""Shrinkage of a variance toward the median of all places: a few frames cannot distinguish a quiet
place from a lucky one, and none is free of noise."""
_STILL_DEG_S = 1e-6


@dataclass(frozen=True)
class WideField:
    """A matched filter for a rotation rate; see `fit_wide_field`."""

    slopes: Floats
    """f: local responses per unit of rate, of the shape of one frame's responses"""
    weights: Floats
    """w; 0 where a response was undefined throughout a half"""
    squared_snr: Floats
    """q: squared signal-to-noise ratio of a response at a rate of 1"""
    standard_error: float
    """Standard deviation of a rate (unit of the rates), for noise as in the fit"""

    def rates(self, answers: Floats) -> Floats:
        """Return the rotation rate at each time, (T,); NaN if no response is defined.

        Raises ValueError if their shape differs from that of the fit.

        `answers` (T, ...): from the detector that the filter was fitted to, at the same frame size.
        """
        if answers.shape[1:] != self.slopes.shape:
            raise ValueError(
                f"responses of shape {answers.shape}: the filter was fitted to (T,"
                f" {', '.join(map(str, self.slopes.shape))})"
            )
        flat, weights = answers.reshape(len(answers), -1), self.weights.ravel()
        sums = np.where(np.isfinite(flat), flat, 0) @ weights
        normalizations = np.isfinite(flat) @ self.squared_snr.ravel()
        with np.errstate(invalid="ignore"):  # 0/0 where none is defined
            return np.asarray(sums / normalizations)


def fit_wide_field(answers: Floats, rates: Floats) -> WideField:
    """Return the matched filter learned from responses to a known rotation.

    `answers` (T, ...): responses (T, H, W) or velocities (T − 1, rows, columns, 2) of one detector,
    NaN where undefined; `rates` (T,): rotation rate at the same times, in any unit.

    Raises ValueError if the two differ in length, the rates are all 0 in one half, or no response
    depends on them beyond its noise.
    """
    if rates.shape != answers.shape[:1]:
        raise ValueError(f"rates of shape {rates.shape} for {len(answers)} answers: give one each")
    halves = slice(None, len(rates) // 2), slice(len(rates) // 2, None)
    return _field(*(_sums(answers[half], rates[half]) for half in halves))


def _field(first: Floats, second: Floats) -> WideField:
    """Return the matched filter learned from the sums over two halves; as `fit_wide_field`."""
    both = first + second
    slopes, known = _slopes(both), (first[1] > 0) & (second[1] > 0)
    if not known.any():
        raise ValueError(
            "no response is defined while the camera turns, in both halves of the sequence: give"
            " rates other than 0"
        )
    products, _, squares, count = both
    variances = np.maximum(squares - slopes * products, 0) / np.maximum(count, 1)
    typical = float(np.median(variances[known]) or variances.mean()) or 1.0
    noise = _SHARED * typical + (1 - _SHARED) * variances
    in_first, in_second = _slopes(first), _slopes(second)
    weights = np.where(known, (in_first + in_second) / 2, 0) / noise
    squared_snr = np.where(known, in_first * in_second, 0) / noise
    total = float(squared_snr.sum())
    if total <= 0:
        raise ValueError(
            "no response depends on the rate, beyond its noise: use another detector, or more"
            " frames"
        )
    error = float(np.sqrt(np.sum(weights**2 * noise))) / total
    return WideField(slopes, weights, squared_snr, error)


def _sums(answers: Floats, rates: Floats) -> Floats:
    """Return sums for slopes and noise of responses (n, ...) at known rates (n,), (4, ...).

    Sums over time, where the response is defined: response · rate, rate², response², and 1.
    """
    omega = rates.reshape(-1, *[1] * (answers.ndim - 1))
    defined = np.isfinite(answers)
    known = np.where(defined, answers, 0)
    terms = known * omega, omega**2 * defined, known**2, defined
    return np.stack([each.sum(axis=0) for each in terms])


def _slopes(sums: Floats) -> Floats:
    """Return the slope of each response over the rate; 0 where unknown."""
    products, power = sums[:2]
    out = np.zeros_like(products)
    return np.asarray(np.divide(products, power, out=out, where=power > 0))


@dataclass(frozen=True)
class RotationError:
    """Error of the yaw rate by a detector's responses (deg/s, positive to the right)."""

    true_deg_s: float
    """RMS of the true rate over the test frames"""
    ideal_deg_s: float
    """RMS error with noise-free responses"""
    counts_deg_s: float
    """RMS error with counts"""


def yaw_rates_deg_s(path: Path) -> Floats:
    """Return the camera's yaw rate, positive to its right, between frames, (T − 1,)."""
    rotations = Rotation.from_matrix(path.poses()[:, :3, :3])
    # Camera axes: y points down, so a turn about it goes from forward (z) to the right (x).
    steps = (rotations[:-1].inv() * rotations[1:]).as_rotvec(degrees=True)
    return np.asarray(steps[:, 1] * path.frame_rate_hz)


class YawRateTest:
    """Learn the yaw rate from the first half of a sequence, and test it on the second.

    True rates (T − 1,) are in deg/s; the detector settles in the frames of the warm-up.
    """

    def __init__(self, detector: Detector, rates: Floats, warm_up: int) -> None:
        self._rates = rates
        # the last response belongs to the last rate, whether there is one per frame or per pair
        self._next = 0 if detector.gives == "velocity" else -1
        half = max(0, len(rates) - warm_up) // 2
        self._bounds = warm_up, warm_up + half // 2, warm_up + half, len(rates)
        turns = half > 0 and np.abs(rates[warm_up : warm_up + half]).max() >= _STILL_DEG_S
        self._is_on = detector.tells_direction and turns
        self._halves: list[Floats] = [np.zeros(()), np.zeros(())]
        self._field: WideField | None = None
        self._errors: list[Floats] = []

    def add(self, ideal: Floats, noisy: Floats) -> None:
        """Add the next responses to the noise-free readings and to the counts, (n, ...) each."""
        numbers = self._next + np.arange(len(ideal))
        self._next += len(ideal)
        if not self._is_on:
            return
        parts = np.searchsorted(self._bounds, numbers, side="right")
        for half in range(2):
            mine = parts == half + 1
            self._halves[half] = self._halves[half] + _sums(ideal[mine], self._rates[numbers[mine]])
        tried = parts == len(self._bounds) - 1
        if tried.any():
            try:
                self._field = self._field or _field(*self._halves)
            except ValueError:  # no motion detected
                self._is_on = False
                return
            found = [self._field.rates(each[tried]) for each in (ideal, noisy)]
            self._errors.append(np.stack(found) - self._rates[numbers[tried]])

    def result(self) -> RotationError | None:
        """Return the error of the yaw rate; None without direction, rotation or enough frames."""
        if not self._errors:
            return None
        truth = self._rates[self._bounds[2] :]
        ideal, noisy = np.concatenate(self._errors, axis=1)
        return RotationError(_rms(truth), _rms(ideal), _rms(noisy))


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
