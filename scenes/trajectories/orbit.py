"""Camera on a circle around a point, or around a scene, all of which it sees."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from megalopta.assets_gen import cross, lengths
from megalopta.core.arrays import Floats
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.motion import Vector
from megalopta.scenes.scene import Scene
from megalopta.scenes.trajectories.base import Path, looking


class Orbit(Path, frozen=True):
    """Level circle around a point, which stays at the image center."""

    kind: Literal["orbit"] = "orbit"
    center_m: Vector = (0.0, 0.0, 1.5)
    """Point at the image center (x, y, z in m; z is up)."""
    radius_m: Annotated[float, Field(gt=0)] = 5.0
    """Radius of the circle (m)."""
    height_m: float = 0.0
    """Height of the circle above the point (m)."""
    rate_deg_s: float = 10.0
    """Angular rate (degrees/s); positive is counterclockwise seen from above."""
    start_deg: float = 180.0
    """Position of the first frame on the circle (degrees from +x toward +y)."""

    def course(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Positions (n, 3), m, and rotations (n, 3, 3), camera axes to world."""
        angle = np.radians(self.start_deg + self.rate_deg_s * times_s)
        outward = np.stack(
            [
                self.radius_m * np.cos(angle),
                self.radius_m * np.sin(angle),
                np.full_like(angle, self.height_m),
            ],
            axis=-1,
        )
        return np.asarray(self.center_m) + outward, looking(-outward, (0, 0, 1))

    def __str__(self) -> str:
        """Camera motion."""
        return (
            f"circles a point at {self.radius_m:g} m by {abs(self.rate_deg_s):g}° per second, "
            "looking at it"
        )


_MARGIN = 0.04
"""Least distance of the scene from the image's border, over the size of the image"""
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

    def around(self, bounds: Floats, camera: Camera) -> Orbit:
        """Return the circle around a box, of lowest and highest corner (2, 3), m."""
        center, half = bounds.mean(axis=0), float(np.linalg.norm(np.diff(bounds, axis=0))) / 2
        corners = np.stack(np.meshgrid(*bounds.T, indexing="ij"), axis=-1).reshape(-1, 3)
        # Numbers of a few digits can be typed.
        step = 10.0 ** (np.floor(np.log10(half)) - _DIGITS + 1)
        shared = {name: getattr(self, name) for name in ("frames", "frame_rate_hz", "mount")}
        x, y, z = (np.round(center / step) * step).round(12).tolist()
        elevation = np.radians(self.elevation_deg)
        for distance in np.geomspace(0.6, 1e5, 500) * half:  # in half diagonals of the scene
            orbit = Orbit(
                **shared,
                center_m=(x, y, z),
                radius_m=float(f"{distance * np.cos(elevation):.{_DIGITS}g}"),
                height_m=float(f"{distance * np.sin(elevation):.{_DIGITS}g}"),
                rate_deg_s=self.rate_deg_s,
            )
            # All corners are within the image from all around.
            around = orbit.model_copy(update={"rate_deg_s": 360 / _AZIMUTHS, "mount": None})
            positions, rotations = around.course(np.arange(_AZIMUTHS, dtype=float))
            places = np.einsum("nij,nki->nkj", rotations, corners - positions[:, None])
            image = camera.project(places) / [camera.width, camera.height]
            if ((image > _MARGIN) & (image < 1 - _MARGIN)).all():
                break
        return orbit

    def course(self, times_s: Floats) -> tuple[Floats, Floats]:
        """Raise ValueError: there is no path before the scene is known."""
        raise ValueError("trajectory.kind 'fit': the scene is not known; load the configuration")

    def __str__(self) -> str:
        """Camera motion."""
        return "circles the scene, all of which it sees"


def bounds_of(scene: Scene) -> Floats:
    """Lowest and highest corner (2, 3), m, of the surfaces of a scene at time 0.

    Without vertices of no surface, without lamps if anything else is there, and without grounds and
    domes: surfaces around all others and 20 times as large.
    """
    boxes, lamps = [], []
    for placement in scene.placements:
        for material, mesh in scene.assets[placement.asset].parts.items():
            a, b, c = np.asarray(mesh.vertices)[np.asarray(mesh.faces).T]
            solid = np.asarray(mesh.faces)[lengths(cross(b - a, c - a)) > 0]
            points = mesh.vertices[np.unique(solid)] @ placement.to_world[:3, :3].T
            points = points + placement.to_world[:3, 3]
            if placement.motion:
                points = placement.motion.carry(points, 0.0)
            if len(points):
                boxes.append([points.min(axis=0), points.max(axis=0)])
                lamps.append(bool(scene.materials[material].emission))
    bounds, is_lamp = np.array(boxes).reshape(-1, 2, 3), np.array(lamps, bool)
    if not is_lamp.all():
        bounds = bounds[~is_lamp]
    bounds = bounds[np.argsort(lengths(bounds[:, 1] - bounds[:, 0]), kind="stable")]
    # Bounds of the first k, from the smallest on; and what all others cover together.
    low, high = np.minimum.accumulate(bounds[:, 0]), np.maximum.accumulate(bounds[:, 1])
    covered_low = np.maximum.accumulate(bounds[::-1, 0, :2])[::-1]
    covered_high = np.minimum.accumulate(bounds[::-1, 1, :2])[::-1]
    is_inside = (covered_low[1:] <= low[:-1, :2]) & (covered_high[1:] >= high[:-1, :2])
    sizes = lengths(bounds[:, 1] - bounds[:, 0])
    # a ground or a dome is over 20 times as large as what stands on it or in it
    is_around = is_inside.all(axis=1) & (sizes[1:] > 20.0 * lengths(high - low)[:-1])
    last = int(np.flatnonzero(is_around)[-1]) if is_around.any() else -1
    return np.stack([low[last], high[last]])
