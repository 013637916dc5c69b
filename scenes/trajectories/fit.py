"""Camera on a circle around a scene of files, all of which it sees."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.trajectories.base import Path
from megalopta.scenes.trajectories.orbit import Orbit

_MARGIN = 0.04
"""Least distance of the scene from the image's border, over the size of the image"""
_DISTANCES = np.geomspace(0.6, 1e5, 500)
"""Distances that are tried, over half the scene's diagonal"""
_AZIMUTHS = 16
_DIGITS = 3


class Fit(Path, frozen=True):
    """Circle around the scene's own center, near and far enough to see all of it.

    The configuration replaces it by the `orbit` that it finds.
    """

    kind: Literal["fit"] = "fit"

    elevation_deg: Annotated[float, Field(ge=-80, le=80)] = 20.0
    """Height of the camera above the scene's center, seen from there (degrees)."""

    rate_deg_s: float = 10.0
    """Angular rate (degrees/s); positive is counterclockwise seen from above."""

    start_deg: float = 180.0
    """Position of the first frame on the circle (degrees from +x toward +y)."""

    def around(self, bounds: Floats, camera: Camera) -> Orbit:
        """Return the circle around a box, of lowest and highest corner (2, 3), m."""
        center, half = bounds.mean(axis=0), float(np.linalg.norm(np.diff(bounds, axis=0))) / 2
        corners = np.stack(np.meshgrid(*bounds.T, indexing="ij"), axis=-1).reshape(-1, 3)
        # Numbers of a few digits can be typed.
        step = 10.0 ** (np.floor(np.log10(half)) - _DIGITS + 1)
        shared = {name: getattr(self, name) for name in ("frames", "frame_rate_hz", "mount")}
        x, y, z = (np.round(center / step) * step).round(12).tolist()
        elevation = np.radians(self.elevation_deg)
        for distance in _DISTANCES * half:
            orbit = Orbit(
                **shared,
                center_m=(x, y, z),
                radius_m=float(f"{distance * np.cos(elevation):.{_DIGITS}g}"),
                height_m=float(f"{distance * np.sin(elevation):.{_DIGITS}g}"),
                rate_deg_s=self.rate_deg_s,
                start_deg=self.start_deg,
            )
            if _sees(orbit, corners, camera):
                break
        return orbit

    def course(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Raise ValueError: there is no path before the scene is known."""
        raise ValueError("trajectory.kind 'fit': the scene is not known; load the configuration")

    def __str__(self) -> str:
        """Camera motion."""
        return "circles the scene, all of which it sees"


def _sees(orbit: Orbit, corners: Floats, camera: Camera) -> bool:
    """True if corners (8, 3) of a box are within the image from all around."""
    around = orbit.model_copy(update={"rate_deg_s": 360 / _AZIMUTHS, "mount": None})
    positions, rotations = around.course(np.arange(_AZIMUTHS, dtype=float))
    places = np.einsum("nij,nki->nkj", rotations, corners - positions[:, None])
    image = camera.project(places) / [camera.width, camera.height]
    return bool(((image > _MARGIN) & (image < 1 - _MARGIN)).all())
