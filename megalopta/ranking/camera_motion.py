"""The camera's rotation and heading from velocities, against its true path."""

from typing import Literal, NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from megalopta.arrays import Floats
from megalopta.dataset import Dataset
from megalopta.flow.detectors import BlockGrid
from megalopta.flow.egomotion import camera_motion
from megalopta.scenes.cameras import Camera

_STILL_M = 1e-9


class CameraErrors(NamedTuple):
    """Of one pair of frames, in degrees; NaN where it could not be told."""

    rotation_deg: float
    """Angle of the rotation that is left between the estimated and the true one"""

    heading_deg: float
    """Angle between the estimated and the true direction of translation"""


def camera_errors(dataset: Dataset, grid: BlockGrid, velocities: Floats, pair: int) -> CameraErrors:
    """Return the errors of the motion between a frame and the next.

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
    poses = dataset.configuration.trajectory.poses()[pair : pair + 2]
    turn = poses[0, :3, :3].T @ poses[1, :3, :3]
    way = poses[0, :3, :3].T @ (poses[1, :3, 3] - poses[0, :3, 3])
    centers = _centers(dataset.configuration.camera, grid)
    inside = velocities[1:-1, 1:-1].reshape(-1, 2)
    try:
        found = camera_motion(
            _directions(dataset.configuration.camera, centers),
            _directions(dataset.configuration.camera, centers + inside),
        )
    except ValueError:  # too few blocks have a velocity
        return CameraErrors(np.nan, np.nan)
    left = Rotation.from_rotvec(found.rotation_deg, degrees=True).inv() * Rotation.from_matrix(turn)
    length = float(np.linalg.norm(way))
    heading = np.nan if length < _STILL_M else _angle_deg(found.heading, way / length)
    return CameraErrors(float(np.degrees(left.magnitude())), heading)


def _centers(camera: Camera, grid: BlockGrid) -> Floats:
    """Middles of the blocks inside, (n, 2) in px of the full image."""
    rows, columns = np.meshgrid(
        np.arange(1, grid.rows - 1), np.arange(1, grid.columns - 1), indexing="ij"
    )
    x = (grid.left + (columns.ravel() + 0.5) * grid.block_px) * camera.width / grid.shape[1]
    y = (grid.top + (rows.ravel() + 0.5) * grid.block_px) * camera.height / grid.shape[0]
    return np.column_stack((x, y))


def _directions(camera: Camera, points: Floats) -> Floats:
    """Unit vectors (n, 3) through image coordinates, NaN outside of the image."""
    at = np.nan_to_num(points[:, ::-1].T - 0.5, nan=-1e9)
    mode: Literal["grid-wrap", "constant"] = "grid-wrap" if camera.wraps else "constant"
    each = [
        map_coordinates(axis, at, order=1, mode=mode, cval=np.nan)
        for axis in np.moveaxis(camera.directions(), -1, 0)
    ]
    found = np.stack(each, axis=-1)
    return np.asarray(found / np.linalg.norm(found, axis=-1, keepdims=True))


def _angle_deg(first: Floats, second: Floats) -> float:
    return float(np.degrees(np.arccos(np.clip(first @ second, -1, 1))))
