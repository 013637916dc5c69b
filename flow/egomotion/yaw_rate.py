"""The camera's yaw rate, from its path and from what the detectors answer.

The weights are learned from the noise-free answers to the first half of a sequence, where the rate
is known, and tried on the second half. Detectors that are blind to direction take no part.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from megalopta.flow.detectors import Detector
from megalopta.flow.egomotion.wide_field import fit_wide_field
from megalopta.scenes.trajectories import Path

Floats = NDArray[np.float64]
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


def rotation_error(
    detector: Detector, ideal: Floats, noisy: Floats, rates: Floats, warm_up: int
) -> RotationError | None:
    """Return the error of the yaw rate; None without direction, rotation or frames enough.

    Parameters
    ----------
    detector
        The detector that answered.
    ideal, noisy : (T, H, W) or (T − 1, rows, columns, 2)
        Answers to the noise-free twin and to the counts.
    rates : (T − 1,)
        True yaw rates (deg/s).
    warm_up : int
        Frames in which the detector settles.
    """
    if not detector.tells_direction:
        return None
    # The last answers belong to the last rates, whether there is one per frame or per pair.
    rates, ideal, noisy = (each[warm_up:] for each in _aligned(rates, ideal, noisy))
    half = len(rates) // 2
    if half == 0 or np.abs(rates[:half]).max() < _STILL_DEG_S:
        return None
    try:
        field = fit_wide_field(ideal[:half], rates[:half])
    except ValueError:  # nothing is seen to move
        return None
    truth = rates[half:]
    errors = [field.rates(answers[half:]) - truth for answers in (ideal, noisy)]
    return RotationError(_rms(truth), *map(_rms, errors))


def _aligned(*series: Floats) -> list[Floats]:
    shortest = min(map(len, series))
    return [each[len(each) - shortest :] for each in series]


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
