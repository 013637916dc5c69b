"""Flow and occlusion between any two frames, from depth and poses, without the renderer.

Pixels are projected to points by their stored depth, and points to pixels of another frame by its
pose. Moving points are taken from their stored place along their motion. Conventions: image
coordinates of pixel (i, j) are (i + 1/2, j + 1/2), +x right, +y down; camera axes are right, down,
forward.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from megalopta.core import bounded
from megalopta.core.errors import UserError
from megalopta.dataset.frames import read_truth_frame
from megalopta.dataset.store import Dataset
from megalopta.render import Truth, out_of_view, read_attributes
from megalopta.scenes.cameras.opencv import OpenCVCamera
from megalopta.scenes.forest.sway import Sway
from megalopta.scenes.meshes.animation import NodeMotion
from megalopta.scenes.motion import Motion, ObjectMotion, RigidMotion

Float64 = NDArray[np.float64]

_KEPT = 4
_BEHIND = 1.01
"""A point is hidden where all that the other frame sees around it is nearer by this factor."""


@dataclass(frozen=True)
class View:
    """A frame's camera, pose (4, 4), camera to world, and time, from its truth file."""

    camera: Mapping[str, Any]
    pose: Float64
    time_s: float

    @classmethod
    def of(cls, header: Mapping[str, str]) -> "View":
        """Read a truth file's header."""
        pose = np.array([float(number) for number in header["cameraToWorld"].split()])
        return cls(json.loads(header["camera"]), pose.reshape(4, 4), float(header["timeSeconds"]))

    @cached_property
    def _calibrated(self) -> OpenCVCamera | None:
        """The camera if it is a calibrated one, which knows its own lens."""
        is_calibrated = self.camera["kind"] == "opencv"
        return OpenCVCamera.model_validate(self.camera) if is_calibrated else None

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
        """Points seen by every pixel at unit depth (H, W, 3), in world axes."""
        if self._calibrated:
            rays = self._calibrated.directions()
            reach = self._calibrated.depth(np.ones(rays.shape[:2]))
            return np.asarray(rays / reach[..., None] @ self.pose[:3, :3].T)
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
        """Tangent of the elevation of rows of a panorama."""
        lower, upper = (math.radians(self.camera[f"{end}_deg"]) for end in ("lower", "upper"))
        part = 1 - y / self.camera["height"]
        if self.camera["kind"] == "cylindrical":
            return np.asarray(math.tan(lower) + part * (math.tan(upper) - math.tan(lower)))
        return np.asarray(np.tan(lower + part * (upper - lower)))

    def image_of(self, points: Float64, at_infinity: NDArray[np.bool_]) -> Float64:
        """Image coordinates (..., 2) of points (..., 3), which are directions where at infinity."""
        offset = points - np.where(at_infinity[..., None], 0.0, self.pose[:3, 3])
        if self._calibrated:
            return self._calibrated.project(offset @ self.pose[:3, :3])
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
        """Depth (...) of points (..., 3) as stored in the truth, m."""
        offset = points - self.pose[:3, 3]
        is_fisheye = bool(self.camera.get("fisheye"))
        if self.camera["kind"] in ("perspective", "opencv") and not is_fisheye:
            return np.asarray(offset @ self.pose[:3, 2])
        return np.asarray(np.linalg.norm(offset, axis=-1))

    def way_to(self, image: Float64) -> Float64:
        """Displacement (H, W, 2) from pixels to image coordinates, in a panorama the shorter."""
        way = image - self.pixels()
        if self.camera["kind"] != "perspective" and self.camera.get("fov_deg") == 360:
            half = self.camera["width"] / 2
            way[..., 0] = (way[..., 0] + half) % (2 * half) - half
        return way


def rederived_flow(truth: Truth, view: View, other: View, motions: Mapping[int, Motion]) -> Float64:
    """Flow (H, W, 2) from one frame to another; `motions` are those of moving objects by id."""
    points = carried_points(truth, view, other.time_s, motions)
    return view.way_to(other.image_of(points, np.isinf(truth.depth)))


def carried_points(
    truth: Truth, view: View, time_s: float, motions: Mapping[int, Motion]
) -> Float64:
    """Positions at a time of the points that a frame sees (H, W, 3), m; directions for the sky."""
    is_sky = np.isinf(truth.depth)
    reach = np.where(is_sky, 1.0, truth.depth)[..., None] * view.directions()
    points = reach + np.where(is_sky[..., None], 0.0, view.pose[:3, 3])
    for object_id in np.intersect1d(truth.object_id, list(motions)).tolist():
        mine = truth.object_id == object_id
        placed = motions[object_id].undo(truth.position[mine], view.time_s)
        points[mine] = motions[object_id].carry(placed, time_s)
    return np.asarray(points)


def _motion_from(record: Mapping[str, Any]) -> Motion:
    """Rebuild a motion from the numbers of a scene's record."""
    values = dict(record)
    if values["kind"] == "sway":
        del values["kind"]
        return Sway(**values)
    if values["kind"] == "nodes":
        return NodeMotion.of_record(values)
    center = values.pop("center_m")
    return RigidMotion(tuple(center), TypeAdapter(ObjectMotion).validate_python(values))


def motions_of(dataset: Dataset) -> dict[int, Motion]:
    """Motion of each moving object, by number. Raises UserError."""
    path, again = dataset.scene_record, f"megalopta render {dataset.root} --out {dataset.root}"
    with bounded.undamaged(path, f"remove it and run: {again}"):
        motions = bounded.read_json(path)["motions"]
        return {int(number): _motion_from(each) for number, each in motions.items()}


class _Seen(NamedTuple):
    truth: Truth
    view: View


class TruthReader:
    """Ground truth of the frames of one sequence, with a cache."""

    def __init__(self, dataset: Dataset) -> None:
        self._dataset = dataset
        self._frame = lru_cache(maxsize=_KEPT)(self._read)

    def frame(self, index: int) -> Truth:
        """Truth of a frame. Raises UserError."""
        return self._frame(index).truth

    def flow(self, first: int, second: int) -> NDArray[np.float32]:
        """Flow (H, W, 2), px, from one frame to another."""
        self._check(first, second)
        if second == first + 1:
            return self.frame(first).flow_forward
        if second == first - 1:
            return self.frame(first).flow_backward
        return self._flow_and_depth(first, second)[0].astype(np.float32)

    def flow_to(self, other: "TruthReader", first: int, second: int) -> NDArray[np.float32]:
        """Flow (H, W, 2), px, from a frame to a frame of another camera of the rig."""
        self._check(first, second)
        truth, view = self._frame(first)
        points = carried_points(truth, view, other.view(second).time_s, self._motions)
        image = other.view(second).image_of(points, np.isinf(truth.depth))
        return view.way_to(image).astype(np.float32)

    def view(self, index: int) -> View:
        """Camera, pose and time of a frame."""
        return self._frame(index).view

    def occlusion(self, first: int, second: int) -> NDArray[np.bool_]:
        """Mask (H, W) of a frame's pixels that are hidden in another, or out of its view."""
        self._check(first, second)
        wraps = self._dataset.configuration.camera.wraps
        if abs(second - first) == 1:
            truth, way = self.frame(first), "forward" if second > first else "backward"
            hidden = getattr(truth, f"occluded_{way}")
        else:
            flow, depth = self._flow_and_depth(first, second)
            hidden = _is_behind(flow, depth, self.frame(second).depth, wraps)
        return np.asarray(hidden | out_of_view(self.flow(first, second), wraps))

    @cached_property
    def _motions(self) -> Mapping[int, Motion]:
        return motions_of(self._dataset)

    def _flow_and_depth(self, first: int, second: int) -> tuple[Float64, Float64]:
        """Flow to another frame, and the depth (H, W) of its points there."""
        (truth, view), (_, other) = self._frame(first), self._frame(second)
        points = carried_points(truth, view, other.time_s, self._motions)
        is_sky = np.isinf(truth.depth)
        flow = view.way_to(other.image_of(points, is_sky))
        return flow, np.where(is_sky, np.inf, other.depth_of(points))

    def _read(self, index: int) -> _Seen:
        truth = read_truth_frame(self._dataset, index)
        header = read_attributes(self._dataset.exposed_truth(index))
        return _Seen(truth, View.of(header))

    def _check(self, *frames: int) -> None:
        count = self._dataset.configuration.trajectory.frames
        for frame in frames:
            if not 0 <= frame < count:
                raise UserError(f"frame {frame}: the sequence has frames 0 to {count - 1}")


def _is_behind(
    flow: Float64,
    depth: Float64,
    seen: NDArray[np.float32],
    wraps: bool,
) -> NDArray[np.bool_]:
    """Mask of points at a depth (H, W) behind everything seen in the four pixels around them."""
    height, width = depth.shape
    target = np.nan_to_num(flow, nan=-1e9)
    x = np.floor(np.arange(width) + target[..., 0]).astype(np.int64)
    y = np.floor(np.arange(height)[:, np.newaxis] + target[..., 1]).astype(np.int64)
    farthest = np.zeros(depth.shape)
    for right in (0, 1):
        for down in (0, 1):
            columns = (x + right) % width if wraps else np.clip(x + right, 0, width - 1)
            rows = np.clip(y + down, 0, height - 1)
            farthest = np.maximum(farthest, seen[rows, columns])
    return np.asarray(depth > _BEHIND * farthest)
