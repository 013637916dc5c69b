"""Where the camera is at each frame: turning in place, moving along a line, or both at once.

A pose is a (4, 4) matrix from camera axes (+x right, +y down, +z forward) to world meters.
"""

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, model_validator
from scipy.spatial.transform import Rotation

Vector = tuple[float, float, float]


class Trajectory(
    BaseModel, frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
):
    """Steady rotation about `up` together with steady translation; either rate may be zero."""

    frames: Annotated[int, Field(ge=1)] = 32
    """Number of frames."""

    frame_rate_hz: Annotated[float, Field(gt=0)] = 10.0
    """Frames per second (Hz)."""

    position_m: Vector = (0.0, 0.0, 1.5)
    """Camera position at the first frame (x, y, z in m; z is up)."""

    look_at_m: Vector = (10.0, 0.0, 1.5)
    """Point seen at the image center of the first frame (x, y, z in m)."""

    up: Vector = (0.0, 0.0, 1.0)
    """Direction that is up in the image; also the axis of rotation."""

    rotation_deg_s: float = 0.0
    """Turning rate about `up` (degrees/s); positive turns left, so that the image moves right."""

    velocity_m_s: Vector = (0.0, 0.0, 0.0)
    """Velocity (x, y, z in m/s)."""

    @model_validator(mode="after")
    def _view_is_defined(self) -> "Trajectory":
        view = np.subtract(self.look_at_m, self.position_m)
        if not np.any(view):
            raise ValueError(
                f"look_at_m {self.look_at_m} equals position_m: move one of them to define a view"
            )
        lengths = np.linalg.norm(view) * np.linalg.norm(self.up)
        if np.linalg.norm(np.cross(view, self.up)) <= 1e-6 * lengths:
            raise ValueError(
                f"up {self.up} is parallel to the view from position_m {self.position_m} to "
                f"look_at_m {self.look_at_m}: tilt one of them"
            )
        return self

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Time of each frame (T,), s."""
        return np.arange(self.frames) / self.frame_rate_hz

    def poses(self) -> NDArray[np.float64]:
        """Camera-to-world matrices (T, 4, 4).

        Positions are rounded to float32, the renderer's precision: the stored pose is the pose that
        was rendered, also far from the origin.
        """
        times = self.times_s
        up = np.asarray(self.up) / np.linalg.norm(self.up)
        angles = np.radians(self.rotation_deg_s) * times
        turns = Rotation.from_rotvec(angles[:, None] * up).as_matrix()
        poses = np.tile(np.eye(4), (self.frames, 1, 1))
        poses[:, :3, :3] = turns @ _orientation(np.subtract(self.look_at_m, self.position_m), up)
        positions = np.asarray(self.position_m) + times[:, None] * np.asarray(self.velocity_m_s)
        poses[:, :3, 3] = positions.astype(np.float32)
        return poses


def _orientation(view: NDArray[np.float64], up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation matrix (3, 3) whose columns are the camera axes: right, down, forward."""
    forward = view / np.linalg.norm(view)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(forward, right), forward])
