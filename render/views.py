"""From where each pixel looks, and when: all at one instant, or row by row.

Coordinates are relative to the scene's `origin_m`.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from megalopta.scenes.camera import Camera

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Eyes:
    """Where N rays start and how the camera is turned there.

    Attributes
    ----------
    origin : (3,) or (N, 3)
        Camera position, m; one for all rays or one for each.
    rotation : (3, 3) or (N, 3, 3)
        Camera axes to world.
    """

    origin: Float64
    rotation: Float64

    def to_world(self, vectors: Float64) -> Float64:
        """Vectors (N, 3) in world axes of those in camera axes."""
        return np.asarray(np.matmul(self.rotation, vectors[..., None])[..., 0])

    def to_camera(self, vectors: Float64) -> Float64:
        """Vectors (N, 3) in camera axes of those in world axes."""
        return np.asarray(np.matmul(self.rotation.swapaxes(-1, -2), vectors[..., None])[..., 0])


class View(Protocol):
    """How a frame is taken."""

    @property
    def time_s(self) -> float:
        """Time of the scene, whatever the shutter does."""

    def pixels(self, camera: Camera) -> Eyes:
        """Eyes of the H·W pixels."""

    def seeing(self, camera: Camera, points: Float64, is_sky: NDArray[np.bool_]) -> Eyes:
        """Eyes that see points (N, 3), which are directions where they are of the sky."""


@dataclass(frozen=True)
class Instant:
    """A frame taken at once.

    Attributes
    ----------
    time_s : float
        When.
    pose : (4, 4)
        Camera to world.
    """

    time_s: float
    pose: Float64

    def pixels(self, camera: Camera) -> Eyes:
        """Eyes of the H·W pixels."""
        return Eyes(self.pose[:3, 3], self.pose[:3, :3])

    def seeing(self, camera: Camera, points: Float64, is_sky: NDArray[np.bool_]) -> Eyes:
        """Eyes that see points (N, 3): the same for all."""
        return self.pixels(camera)
