"""From where each pixel looks, and when: all at one instant, or row by row.

Coordinates are relative to the scene's `origin_m`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from megalopta.scenes import Shutter
from megalopta.scenes.cameras import Camera

Float64 = NDArray[np.float64]

# Each step is shorter than the one before by the way of the image during the readout over its
# height, so the last one is far below this; float32 positions allow no less.
_ITERATIONS, _TOLERANCE_PX = 60, 1e-4


@dataclass(frozen=True)
class Eyes:
    """Where N rays start and how the camera is turned there."""

    origin: Float64
    """(3,) or (N, 3): camera position, m; one for all rays or one for each."""
    rotation: Float64
    """(3, 3) or (N, 3, 3): camera axes to world."""

    def to_world(self, vectors: Float64) -> Float64:
        """Vectors (N, 3) in world axes of those in camera axes."""
        return _times(self.rotation, vectors)

    def to_camera(self, vectors: Float64) -> Float64:
        """Vectors (N, 3) in camera axes of those in world axes."""
        return _times(self.rotation.swapaxes(-1, -2), vectors)

    def of(self, ray: slice | NDArray[np.int64], times: int = 1) -> "Eyes":
        """Eyes of some of the rays, each for so many of a new set."""
        if self.origin.ndim == 1:
            return self
        return Eyes(self.origin[ray].repeat(times, 0), self.rotation[ray].repeat(times, 0))


def _times(rotation: Float64, vectors: Float64) -> Float64:
    # Not matmul, which wakes all of BLAS's threads for products of three numbers.
    each = "ij,nj->ni" if rotation.ndim == 2 else "nij,nj->ni"
    return np.asarray(np.einsum(each, rotation, vectors))


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
    """A frame taken at once."""

    time_s: float
    pose: Float64
    """(4, 4): camera to world."""

    def pixels(self, camera: Camera) -> Eyes:
        """Eyes of the H·W pixels."""
        return Eyes(self.pose[:3, 3], self.pose[:3, :3])

    def seeing(self, camera: Camera, points: Float64, is_sky: NDArray[np.bool_]) -> Eyes:
        """Eyes that see points (N, 3): the same for all."""
        return self.pixels(camera)


@dataclass(frozen=True)
class Rolling:
    """A frame taken row by row, of a scene at rest."""

    time_s: float
    """Of the middle row."""
    shutter: Shutter
    pose_at: Callable[[Float64], Float64]
    """Poses (n, 4, 4) at times (n,), s."""

    def pixels(self, camera: Camera) -> Eyes:
        """Eyes of the H·W pixels: each row has its own."""
        rows = self._eyes(np.arange(camera.height, dtype=float) + 0.5, camera)
        return Eyes(rows.origin.repeat(camera.width, 0), rows.rotation.repeat(camera.width, 0))

    def seeing(self, camera: Camera, points: Float64, is_sky: NDArray[np.bool_]) -> Eyes:
        """Eyes that see points (N, 3): of the row that each is seen in.

        That row is the fixed point of "seen in row y at the time of row y". Where it is not found,
        because the image moves by more than the rows do, the rotation is NaN. Points farther out
        of the image than its height are seen at the time of that place.
        """
        y = np.full(len(points), camera.height / 2)
        for _ in range(_ITERATIONS):
            eyes = self._eyes(y, camera)
            way = np.where(is_sky[:, None], points, points - eyes.origin)
            seen = camera.project(eyes.to_camera(way))[:, 1]
            seen = np.clip(np.where(np.isnan(seen), y, seen), -camera.height, 2 * camera.height)
            step = np.abs(seen - y)
            y = seen
            if step.max() < _TOLERANCE_PX:
                break
        eyes = self._eyes(y, camera)
        lost = (step >= _TOLERANCE_PX)[:, None, None]
        return Eyes(eyes.origin, np.where(lost, np.nan, eyes.rotation))

    def _eyes(self, y: Float64, camera: Camera) -> Eyes:
        poses = self.pose_at(self.time_s + self.shutter.delay_s(y, camera.height))
        return Eyes(poses[:, :3, 3], poses[:, :3, :3])
