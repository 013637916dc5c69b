"""The camera's yaw rate, from its path and from what the detectors answer.

The weights are learned from the noise-free answers to the first half of a sequence, where the rate
is known, and tried on the second half. Detectors that are blind to direction take no part.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats
from megalopta.flow.detectors.base import Detector
from megalopta.flow.egomotion.wide_field import SlopeSums, WideField, field_of_halves
from megalopta.scenes.trajectories.base import Path

_STILL_DEG_S = 1e-6


@dataclass(frozen=True)
class RotationError:
    """How well a detector's answers give the yaw rate (deg/s, positive to the right)."""

    true_deg_s: float
    """Root mean square of the true rate over the frames tried"""

    ideal_deg_s: float
    """Root mean square error on noise-free answers"""

    counts_deg_s: float
    """Root mean square error on counts"""


def yaw_rates_deg_s(path: Path) -> Floats:
    """Return the rate at which the camera turns to its own right between frames, (T − 1,)."""
    rotations = Rotation.from_matrix(path.poses()[:, :3, :3])
    # Camera axes: y points down, so a turn about it leads from forward (z) to the right (x).
    steps = (rotations[:-1].inv() * rotations[1:]).as_rotvec(degrees=True)
    return np.asarray(steps[:, 1] * path.frame_rate_hz)


class YawRateTest:
    """Learns the yaw rate from the first half of a sequence and tries it on the second.

    Parameters
    ----------
    detector
        The detector that answers.
    rates : (T − 1,)
        True yaw rates (deg/s).
    warm_up : int
        Frames in which the detector settles.
    """

    def __init__(self, detector: Detector, rates: Floats, warm_up: int) -> None:
        self._rates = rates
        # the last answer belongs to the last rate, whether there is one per frame or per pair
        self._next = 0 if detector.gives == "velocity" else -1
        half = max(0, len(rates) - warm_up) // 2
        self._bounds = warm_up, warm_up + half // 2, warm_up + half, len(rates)
        learned = rates[warm_up : warm_up + half]
        self._turns = half > 0 and np.abs(learned).max() >= _STILL_DEG_S
        self._is_on = detector.tells_direction and self._turns
        self._halves = SlopeSums(), SlopeSums()
        self._field: WideField | None = None
        self._errors: list[Floats] = []

    def add(self, ideal: Floats, noisy: Floats) -> None:
        """Take in the next answers to the noise-free twin and to the counts, (n, ...) each."""
        first, self._next = self._next, self._next + len(ideal)
        if not self._is_on:
            return
        for index, sums in enumerate(self._halves):
            here, at = self._overlap(first, index)
            sums.add(ideal[here], self._rates[at])
        here, at = self._overlap(first, 2)
        if at.start < at.stop:
            self._try(ideal[here], noisy[here], self._rates[at])

    def result(self) -> RotationError | None:
        """Return the error of the yaw rate; None without direction, rotation or frames enough."""
        if not self._errors:
            return None
        truth = self._rates[self._bounds[2] :]
        ideal, noisy = np.concatenate(self._errors, axis=1)
        return RotationError(_rms(truth), _rms(ideal), _rms(noisy))

    def _overlap(self, first: int, part: int) -> tuple[slice, slice]:
        """Which of the answers from rate number `first` on lie in a part, and at which rates."""
        start = max(self._bounds[part], first)
        stop = max(start, min(self._bounds[part + 1], self._next))
        return slice(start - first, stop - first), slice(start, stop)

    def _try(self, ideal: Floats, noisy: Floats, truth: Floats) -> None:
        try:
            self._field = self._field or field_of_halves(*self._halves)
        except ValueError:  # nothing is seen to move
            self._is_on = False
            return
        answers = self._field.rates(ideal), self._field.rates(noisy)
        self._errors.append(np.stack(answers) - truth)


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
