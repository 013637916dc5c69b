"""Flow once more, from depth and poses alone: plain formulas of projection, no renderer.

Pixels are taken to points by the depth they store, and points to pixels of another frame by its
pose. Things that move are taken from the place the truth stores to where their motion brings them.
Conventions: image coordinates of pixel (i, j) are (i + 1/2, j + 1/2), +x right, +y down; camera
axes are right, down, forward.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from megalopta.core import bounded
from megalopta.core.errors import UserError
from megalopta.dataset.store import Dataset
from megalopta.render import Truth
from megalopta.scenes.forest.sway import Sway
from megalopta.scenes.motion import Motion, ObjectMotion, RigidMotion

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """A frame's camera, pose (4, 4), camera to world, and time, as its truth file tells them."""

    camera: Mapping[str, Any]
    pose: Float64
    time_s: float

    @classmethod
    def of(cls, header: Mapping[str, str]) -> "View":
        """Read a truth file's header."""
        pose = np.array([float(number) for number in header["cameraToWorld"].split()])
        return cls(json.loads(header["camera"]), pose.reshape(4, 4), float(header["timeSeconds"]))

    @property
    def _per_radian(self) -> float:
        """Columns per radian of azimuth, or the pinhole's focal length (px)."""
        width, fov = self.camera["width"], math.radians(self.camera["fov_deg"])
        is_pinhole = self.camera["kind"] == "perspective"
        return float(width / (2 * math.tan(fov / 2)) if is_pinhole else width / fov)

    def pixels(self) -> Float64:
        """Centers of all pixels (H, W, 2)."""
        x, y = np.meshgrid(np.arange(self.camera["width"]), np.arange(self.camera["height"]))
        return np.stack([x, y], axis=-1) + 0.5

    def directions(self) -> Float64:
        """What every pixel sees at unit depth (H, W, 3), in world axes."""
        x, y = np.moveaxis(self.pixels(), -1, 0)
        x = x - self.camera["width"] / 2
        if self.camera["kind"] == "perspective":
            y = y - self.camera["height"] / 2
            seen = np.stack([x, y, np.full_like(x, self._per_radian)], axis=-1) / self._per_radian
        else:
            azimuth, up = x / self._per_radian, self._rise(y)
            seen = np.stack([np.sin(azimuth), -up, np.cos(azimuth)], axis=-1)
            seen /= np.linalg.norm(seen, axis=-1, keepdims=True)
        return np.asarray(seen @ self.pose[:3, :3].T)

    def _rise(self, y: Float64) -> Float64:
        """Tangent of the elevation that rows of a panorama see."""
        lower, upper = (math.radians(self.camera[f"{end}_deg"]) for end in ("lower", "upper"))
        part = 1 - y / self.camera["height"]
        if self.camera["kind"] == "cylindrical":
            return np.asarray(math.tan(lower) + part * (math.tan(upper) - math.tan(lower)))
        return np.asarray(np.tan(lower + part * (upper - lower)))

    def image_of(self, points: Float64, at_infinity: NDArray[np.bool_]) -> Float64:
        """Where points (..., 3) are seen (..., 2); they are directions where at infinity."""
        offset = points - np.where(at_infinity[..., None], 0.0, self.pose[:3, 3])
        right, down, ahead = np.moveaxis(offset @ self.pose[:3, :3], -1, 0)
        width, height = self.camera["width"], self.camera["height"]
        with np.errstate(divide="ignore", invalid="ignore"):
            if self.camera["kind"] == "perspective":
                x, y = (np.where(ahead > 0, part / ahead, np.nan) for part in (right, down))
                return np.stack(
                    [x * self._per_radian + width / 2, y * self._per_radian + height / 2], axis=-1
                )
            rise = -down / np.hypot(right, ahead)
            lower, upper = (math.radians(self.camera[f"{end}_deg"]) for end in ("lower", "upper"))
            if self.camera["kind"] == "cylindrical":
                part = (math.tan(upper) - rise) / (math.tan(upper) - math.tan(lower))
            else:
                part = (upper - np.arctan(rise)) / (upper - lower)
            x = np.arctan2(right, ahead) * self._per_radian + width / 2
        return np.stack([x, part * height], axis=-1)

    def depth_of(self, points: Float64) -> Float64:
        """Depth (...) of points (..., 3) as the truth stores it, m."""
        offset = points - self.pose[:3, 3]
        if self.camera["kind"] == "perspective":
            return np.asarray(offset @ self.pose[:3, 2])
        return np.asarray(np.linalg.norm(offset, axis=-1))

    def way_to(self, image: Float64) -> Float64:
        """Way (H, W, 2) from pixels to image coordinates, the shorter one around a full circle."""
        way = image - self.pixels()
        if self.camera["kind"] != "perspective" and self.camera["fov_deg"] == 360:
            half = self.camera["width"] / 2
            way[..., 0] = (way[..., 0] + half) % (2 * half) - half
        return way


def rederived_flow(truth: Truth, view: View, other: View, motions: Mapping[int, Motion]) -> Float64:
    """Flow (H, W, 2) from one frame to another; `motions` are those of the moving objects by id."""
    points = carried_points(truth, view, other.time_s, motions)
    return view.way_to(other.image_of(points, np.isinf(truth.depth)))


def carried_points(
    truth: Truth, view: View, time_s: float, motions: Mapping[int, Motion]
) -> Float64:
    """Where the points that a frame sees are at a time (H, W, 3), m; of the sky, directions."""
    is_sky = np.isinf(truth.depth)
    reach = np.where(is_sky, 1.0, truth.depth)[..., None] * view.directions()
    points = reach + np.where(is_sky[..., None], 0.0, view.pose[:3, 3])
    for object_id in np.intersect1d(truth.object_id, list(motions)).tolist():
        mine = truth.object_id == object_id
        placed = motions[object_id].undo(truth.position[mine], view.time_s)
        points[mine] = motions[object_id].carry(placed, time_s)
    return np.asarray(points)


def _motion_from(record: Mapping[str, Any]) -> Motion:
    """Make a motion again from the numbers of a scene's record."""
    values = dict(record)
    if values["kind"] == "sway":
        del values["kind"]
        return Sway(**values)
    center = values.pop("center_m")
    return RigidMotion(tuple(center), TypeAdapter(ObjectMotion).validate_python(values))


def motions_of(dataset: Dataset) -> dict[int, Motion]:
    """Motion of each object that moves, by its number. Raises UserError."""
    path = dataset.scene_record
    try:
        motions = bounded.read_json(path)["motions"]
        return {int(number): _motion_from(each) for number, each in motions.items()}
    except (OSError, ValueError, LookupError, TypeError, AttributeError):
        raise UserError(
            f"{path} is damaged; remove it and run: megalopta render {dataset.root} "
            f"--out {dataset.root}"
        ) from None
