"""Camera poses and times of pixels: all at one instant, or line by line.

Coordinates are relative to the scene's `origin_m`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from megalopta.core.arrays import Floats, Ints, Mask
from megalopta.scenes import Shutter
from megalopta.scenes.cameras.base import Camera

Times = float | Floats
"""One time for all, or one for each."""

# Each step is shorter than the previous one by the displacement of the image during the readout
# over its size, so the last one is far below this; float32 positions allow no less.
_ITERATIONS, _TOLERANCE_PX = 60, 1e-4


@dataclass(frozen=True)
class Eyes:
    """Origins, camera rotations and times of N rays."""

    origin: Floats
    """(3,) or (N, 3): camera position, m; one for all rays or one for each."""
    rotation: Floats
    """(3, 3) or (N, 3, 3): camera axes to world."""
    time_s: Times
    """Time: one for all rays or one for each (N,)."""

    def to_world(self, vectors: Floats) -> Floats:
        """Convert vectors (N, 3) from camera axes to world axes."""
        return _times(self.rotation, vectors)

    def to_camera(self, vectors: Floats) -> Floats:
        """Convert vectors (N, 3) from world axes to camera axes."""
        return _times(self.rotation.swapaxes(-1, -2), vectors)

    def of(self, ray: slice | Ints, times: int = 1) -> "Eyes":
        """Eyes of some of the rays, each repeated for a number of new rays."""
        if isinstance(self.time_s, float):
            return self
        return Eyes(
            *(part[ray].repeat(times, 0) for part in (self.origin, self.rotation, self.time_s))
        )

    def way(self, points: Floats, is_sky: Mask) -> Floats:
        """Vectors (N, 3) to points (N, 3), which are directions for the sky (N,)."""
        return np.where(is_sky[:, None], points, points - self.origin)


def _times(rotation: Floats, vectors: Floats) -> Floats:
    # Not matmul, which wakes all of BLAS's threads for products of three numbers.
    each = "ij,nj->ni" if rotation.ndim == 2 else "nij,nj->ni"
    return np.asarray(np.einsum(each, rotation, vectors))


Ways = Callable[[Eyes], Floats]
"""Vectors (N, 3) from eyes to N points at the eyes' times."""


def of_rays(times_s: Times, ray: slice | Ints | Mask) -> Times:
    """Times of some of the rays."""
    return times_s if isinstance(times_s, float) else times_s[ray]


@dataclass(frozen=True)
class Instant:
    """Frame taken at an instant."""

    time_s: float
    pose: Floats
    """(4, 4): camera to world."""

    def pixels(self, camera: Camera) -> Eyes:
        """Eyes of the H·W pixels."""
        return Eyes(self.pose[:3, 3], self.pose[:3, :3], self.time_s)

    def seeing(self, camera: Camera, way: Ways, count: int) -> tuple[Eyes, Eyes]:
        """Eyes that see N points, the same for all, twice."""
        eyes = self.pixels(camera)
        return eyes, eyes


@dataclass(frozen=True)
class Rolling:
    """Frame taken line by line, by rows or columns, with moving objects at each line's time."""

    time_s: float
    """Time of the middle line."""
    shutter: Shutter
    pose_at: Callable[[Floats], Floats]
    """Poses (n, 4, 4) at times (n,), s."""

    def pixels(self, camera: Camera) -> Eyes:
        """Eyes of the H·W pixels, one pose per line."""
        across = self.shutter.across
        lines = self._eyes(np.arange(camera.shape[1 - across], dtype=float) + 0.5, camera)
        return lines.of(np.indices(camera.shape)[1 - across].ravel())

    def seeing(self, camera: Camera, way: Ways, count: int) -> tuple[Eyes, Eyes]:
        """Eyes that see N points, at the time of their place, and those of the line around it.

        That place is the fixed point of "seen at y at the time of y", of columns with x. If it is
        not found, because the image moves by more than the lines do, the rotation is NaN. Points
        farther out of the image than its size have the time of that place.
        """
        across = self.shutter.across
        size = camera.shape[1 - across]
        place = np.full(count, size / 2)
        for _ in range(_ITERATIONS):
            eyes = self._eyes(place, camera)
            seen = camera.project(eyes.to_camera(way(eyes)))[:, across]
            seen = np.clip(np.where(np.isnan(seen), place, seen), -size, 2 * size)
            step = np.abs(seen - place)
            place = seen
            if step.max(initial=0) < _TOLERANCE_PX:
                break
        eyes = self._eyes(place, camera)
        lost = (step >= _TOLERANCE_PX)[:, None, None]
        found = replace(eyes, rotation=np.where(lost, np.nan, eyes.rotation))
        return found, self._eyes(np.floor(place) + 0.5, camera)

    def _eyes(self, place: Floats, camera: Camera) -> Eyes:
        size = camera.shape[1 - self.shutter.across]
        times = self.time_s + self.shutter.delay_s(place, size)
        poses = self.pose_at(times)
        return Eyes(poses[:, :3, 3], poses[:, :3, :3], times)


View = Instant | Rolling
"""View of a frame."""
