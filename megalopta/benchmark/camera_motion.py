"""The camera's rotation and heading, from velocities or from photons, against its true path."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats
from megalopta.dataset.store import Dataset
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.egomotion.heading import CameraMotion, motion_of_flow
from megalopta.flow.egomotion.likely_motion import likely_camera_motion
from megalopta.scenes.cameras.base import Camera

LIKELIHOODS: Mapping[str, int] = MappingProxyType(
    {"likelihood, 2 frames": 2, "likelihood, 8 frames": 8}
)
"""Names of the motion under which counts are most likely, and how many frames it is told from"""

_STILL_M = 1e-9


class CameraErrors(NamedTuple):
    """Of one pair of frames, in degrees; NaN where it could not be told."""

    rotation_deg: float
    """Angle of the rotation that is left between the estimated and the true one"""

    heading_deg: float
    """Angle between the estimated and the true direction of translation"""


def chosen_pairs(frames: int, count: int) -> NDArray[np.intp]:
    """Return so many pairs, by their first frames, spread over a sequence of so many frames.

    All have the frames around them that the likelihood sees, if the sequence is long enough.
    """
    most = max(LIKELIHOODS.values())
    before = most // 2 - 1 if frames >= most else 0
    return np.unique(np.linspace(before, frames - 2 - before, count).astype(int))


def likely_motion(
    camera: Camera, counts: NDArray[Any], frames: int, pair: int
) -> tuple[float, ...]:
    """Return rotation and heading, (6,), most likely in so many frames around a pair, or NaN."""
    start = pair - (frames // 2 - 1)
    window = counts[max(start, 0) : start + frames]
    if len(window) < frames or not np.ptp(window):
        return (np.nan,) * 6
    found = likely_camera_motion(window, camera)
    return *found.rotation_deg, *found.heading


def errors_of_flow(
    dataset: Dataset, grid: BlockGrid, velocities: Floats, pair: int
) -> CameraErrors:
    """Return the errors of the motion that fits the flow of a pair best.

    Parameters
    ----------
    dataset
    grid
        Blocks, in the resized image.
    velocities : (rows, columns, 2)
        Of the pair, px of the full image per frame.
    pair : int
        Number of its first frame.
    """
    camera = dataset.configuration.camera
    inside = np.s_[1:-1, 1:-1]
    scale = np.array([camera.width / grid.shape[1], camera.height / grid.shape[0]])
    try:
        found = motion_of_flow(camera, grid.centers[inside] * scale, velocities[inside])
    except ValueError:  # too few blocks have a velocity
        return CameraErrors(np.nan, np.nan)
    return errors_of_motion(dataset, found, pair)


def errors_of_motion(dataset: Dataset, found: CameraMotion, pair: int) -> CameraErrors:
    """Return the errors of a motion between a frame and the next."""
    if np.isnan(found.rotation_deg).any():
        return CameraErrors(np.nan, np.nan)
    poses = dataset.configuration.trajectory.poses()[pair : pair + 2]
    turn = poses[0, :3, :3].T @ poses[1, :3, :3]
    way = poses[0, :3, :3].T @ (poses[1, :3, 3] - poses[0, :3, 3])
    left = Rotation.from_rotvec(found.rotation_deg, degrees=True).inv() * Rotation.from_matrix(turn)
    length = float(np.linalg.norm(way))
    heading = np.nan if length < _STILL_M else _angle_deg(found.heading, way / length)
    return CameraErrors(float(np.degrees(left.magnitude())), heading)


def _angle_deg(first: Floats, second: Floats) -> float:
    return float(np.degrees(np.arccos(np.clip(first @ second, -1, 1))))
