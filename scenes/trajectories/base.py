"""Base of every camera path: frames, times, and a pose (4, 4), camera axes to world, at any time.

Positions are float32 about a local origin, `origin_m`: the stored pose is the rendered pose.
"""

from abc import abstractmethod
from typing import Annotated, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats
from megalopta.core.record import Record
from megalopta.scenes.motion import Vector

_Offset = Annotated[float, Field(ge=-1e3, le=1e3)]
_Degrees = Annotated[float, Field(ge=-360, le=360)]


class Mount(Record, frozen=True):
    """Position and rotation of a camera relative to the path's own camera."""

    position_m: tuple[_Offset, _Offset, _Offset] = (0.0, 0.0, 0.0)
    """Position to the right of, below and ahead of the path's camera (m)."""
    rotation_deg: tuple[_Degrees, _Degrees, _Degrees] = (0.0, 0.0, 0.0)
    """Rotation vector (degrees) about the path's camera axes right, down and forward: (0, 90, 0)
    looks to the right. Its direction is the axis, its length the angle."""

    @property
    def matrix(self) -> Floats:
        """Matrix (4, 4) from this camera's axes to those of the path's camera."""
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_rotvec(self.rotation_deg, degrees=True).as_matrix()
        matrix[:3, 3] = self.position_m
        return matrix

    def baseline_m(self, camera: "Mount") -> float | None:
        """Distance along x to another camera, m, positive to the right.

        None unless both look the same way and stand side by side, as in rectified stereo.
        """
        step = np.linalg.inv(self.matrix) @ camera.matrix
        length = np.linalg.norm(step[:3, 3])
        is_rectified = np.allclose(step[:3, :3], np.eye(3), rtol=0, atol=1e-9)
        is_beside = np.abs(step[1:3, 3]).max() <= 1e-9 * length
        return float(step[0, 3]) if length and is_rectified and is_beside else None


class Path(Record, frozen=True):
    """Frames at a constant rate along a path that is defined at any time."""

    frames: Annotated[int, Field(ge=1, le=1_000_000)] = 32
    """Number of frames."""
    frame_rate_hz: Annotated[float, Field(ge=1e-6, le=1e9)] = 10.0
    """Frames per second (Hz)."""
    mount: Mount | None = Field(default=None, exclude_if=lambda mount: mount is None)
    """Place of the camera on a rig that follows the path; by default, the path is the camera's."""

    @property
    def times_s(self) -> Floats:
        """Time of each frame (T,), s; the first is at 0."""
        return np.arange(self.frames) / self.frame_rate_hz

    @property
    def duration_s(self) -> float:
        """Time from the first frame to the last; for a single frame, its period (s)."""
        return max(self.frames - 1, 1) / self.frame_rate_hz

    @property
    def origin_m(self) -> Vector:
        """Whole meters near the middle of the frames' positions (x, y, z)."""
        positions, _ = self.course(self.times_s)
        # Adding 0 turns negative zero into zero.
        x, y, z = (np.round((positions.min(axis=0) + positions.max(axis=0)) / 2) + 0.0).tolist()
        return x, y, z

    def pose_at(self, times_s: ArrayLike) -> Floats:
        """Camera-to-world matrices (n, 4, 4) at times (n,), s."""
        positions, rotations = self.placed(np.asarray(times_s, dtype=float))
        poses = np.tile(np.eye(4), (len(positions), 1, 1))
        poses[:, :3, :3] = rotations
        origin = np.asarray(self.origin_m)
        poses[:, :3, 3] = (positions - origin).astype(np.float32) + origin
        return poses

    def placed(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Positions (n, 3), m, and rotations (n, 3, 3) of the camera on its mount, not rounded."""
        positions, rotations = self.course(times_s)
        if self.mount is None:
            return positions, rotations
        shifts = rotations @ np.asarray(self.mount.position_m)
        return positions + shifts, rotations @ self.mount.matrix[:3, :3]

    def mounted(self, mount: Mount | None) -> Self:
        """Return the path with another camera on its rig; None is the path's own camera."""
        return self.model_copy(update={"mount": mount})

    def poses(self) -> Floats:
        """Camera-to-world matrices (T, 4, 4) of the frames."""
        return self.pose_at(self.times_s)

    @abstractmethod
    def course(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Positions (n, 3), m, and rotations (n, 3, 3), camera axes to world, before rounding."""

    @abstractmethod
    def __str__(self) -> str:
        """Camera motion, as the end of a sentence that begins with "The camera"."""


def looking(views: Floats, up: ArrayLike) -> Floats:
    """Rotations (n, 3, 3) whose columns are the camera axes right, down and forward.

    Views (n, 3) are of any length; `up` (3,) is up in the image.
    """
    forward = views / np.linalg.norm(views, axis=-1, keepdims=True)
    right = np.cross(forward, np.asarray(up, dtype=float))
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    return np.stack([right, np.cross(forward, right), forward], axis=-1)


class Aimed(Path, frozen=True):
    """Path that starts from its own view."""

    kind: str
    position_m: Vector = (0.0, 0.0, 1.5)
    """Camera position at the first frame; with jitter, its mean (x, y, z in m; z is up)."""
    look_at_m: Vector = (10.0, 0.0, 1.5)
    """Point at the image center of the first frame; jitter is added (x, y, z in m; z is up)."""
    up: Vector = (0.0, 0.0, 1.0)
    """Direction that is up in the image; also the axis of a steady rotation."""

    @model_validator(mode="after")
    def _view_is_defined(self) -> "Aimed":
        view = np.subtract(self.look_at_m, self.position_m)
        if not np.any(view):
            raise ValueError(
                f"look_at_m {self.look_at_m} equals position_m: move one of them to define a view"
            )
        across = np.linalg.norm(np.cross(view, self.up))
        if across <= 1e-6 * np.linalg.norm(view) * np.linalg.norm(self.up):
            raise ValueError(
                f"up {self.up} is parallel to the view from position_m {self.position_m} to "
                f"look_at_m {self.look_at_m}: tilt one of them"
            )
        return self
