"""Flow and occlusion between any two frames, from depth, poses and motions, without rendering.

Flow of skinned and morphed figures is NaN, except between neighbors, which are rendered.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from megalopta.core import bounded
from megalopta.core.errors import UserError
from megalopta.dataset.frames import read_truth_frame
from megalopta.dataset.store import Dataset
from megalopta.render import Truth, out_of_view, read_attributes
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.forest.sway import Sway
from megalopta.scenes.meshes.animation import NodeMotion
from megalopta.scenes.motion import Drift, Motion, RigidMotion

Float64 = NDArray[np.float64]
UNKNOWN = NodeMotion((), np.eye(4), np.full((4, 4), np.nan))
"""Motion of a figure: only its file knows where points between vertices go."""


@dataclass(frozen=True)
class View:
    """A frame's camera, pose (4, 4), camera to world, and time."""

    camera: Camera
    pose: Float64
    time_s: float

    @classmethod
    def of(cls, camera: Camera, header: Mapping[str, str]) -> "View":
        """Read a truth file's header."""
        pose = np.array([float(number) for number in header["cameraToWorld"].split()])
        return cls(camera, pose.reshape(4, 4), float(header["timeSeconds"]))

    def directions(self) -> Float64:
        """Points seen by every pixel at unit depth (H, W, 3), in world axes."""
        reach = self.camera.depth(np.ones(self.camera.shape))
        return np.asarray(self.camera.directions() / reach[..., None] @ self.pose[:3, :3].T)

    def way_to(self, other: "View", points: Float64, is_sky: NDArray[np.bool_]) -> Float64:
        """Displacement (H, W, 2), px, from the pixels to images of points (H, W, 3) in a frame.

        Points of the sky are directions.
        """
        offset = points - np.where(is_sky[..., None], 0.0, other.pose[:3, 3])
        centers = self.camera.pixel_centers()
        return other.camera.displacement(offset @ other.pose[:3, :3], centers)

    def depth_of(self, points: Float64) -> Float64:
        """Depth (...) of points (..., 3) as stored in the truth, m."""
        offset = points - self.pose[:3, 3]
        if self.camera.depth_meaning == "along the ray":
            return np.asarray(np.linalg.norm(offset, axis=-1))
        return np.asarray(offset @ self.pose[:3, 2])


def rederived_flow(truth: Truth, view: View, other: View, motions: Mapping[int, Motion]) -> Float64:
    """Flow (H, W, 2) from one frame to another; `motions` are those of moving objects by id."""
    points = carried_points(truth, view, other.time_s, motions)
    return view.way_to(other, points, np.isinf(truth.depth))


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


def motions_of(dataset: Dataset) -> dict[int, Motion]:
    """Motion of each moving object, by number. Raises UserError."""
    path, motions = dataset.scene_record, dict[int, Motion]()
    with bounded.undamaged(path, f"remove it and run: {dataset.render_again}"):
        for number, record in bounded.read_json(path)["motions"].items():
            values = dict(record)
            motion: Motion
            if values["kind"] == "sway":
                del values["kind"]
                motion = Sway(**values)
            elif values["kind"] == "figure":
                motion = UNKNOWN
            elif values["kind"] == "nodes":
                motion = NodeMotion.of_record(values)
            else:
                center = values.pop("center_m")
                motion = RigidMotion(tuple(center), Drift.model_validate(values))
            motions[int(number)] = motion
    return motions


class TruthReader:
    """Ground truth of the frames of one sequence, with a cache."""

    def __init__(self, dataset: Dataset) -> None:
        self._dataset = dataset
        self._frame = lru_cache(maxsize=4)(self._read)

    def frame(self, index: int) -> Truth:
        """Truth of a frame. Raises UserError."""
        return self._frame(index)[0]

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
        (truth, view), (_, target) = self._frame(first), other._frame(second)
        return rederived_flow(truth, view, target, self._motions).astype(np.float32)

    def occlusion(self, first: int, second: int) -> NDArray[np.bool_]:
        """Mask (H, W) of a frame's pixels that are hidden in another, or out of its view."""
        self._check(first, second)
        wraps = self._dataset.configuration.camera.wraps
        if abs(second - first) == 1:
            truth, way = self.frame(first), "forward" if second > first else "backward"
            hidden = getattr(truth, f"occluded_{way}")
        else:
            flow, depth = self._flow_and_depth(first, second)
            # behind everything seen in the four pixels around the point, by 1 % of its depth
            height, width = depth.shape
            target = np.nan_to_num(flow, nan=-1e9)
            x = np.floor(np.arange(width) + target[..., 0]).astype(np.int64)
            y = np.floor(np.arange(height)[:, np.newaxis] + target[..., 1]).astype(np.int64)
            farthest, seen = np.zeros(depth.shape), self.frame(second).depth
            for right, down in ((0, 0), (0, 1), (1, 0), (1, 1)):
                columns = (x + right) % width if wraps else np.clip(x + right, 0, width - 1)
                rows = np.clip(y + down, 0, height - 1)
                farthest = np.maximum(farthest, seen[rows, columns])
            hidden = depth > 1.01 * farthest
        return np.asarray(hidden | out_of_view(self.flow(first, second), wraps))

    @cached_property
    def _motions(self) -> Mapping[int, Motion]:
        return motions_of(self._dataset)

    def _flow_and_depth(self, first: int, second: int) -> tuple[Float64, Float64]:
        """Flow to another frame, and the depth (H, W) of its points there."""
        (truth, view), (_, target) = self._frame(first), self._frame(second)
        points = carried_points(truth, view, target.time_s, self._motions)
        is_sky = np.isinf(truth.depth)
        depth = np.where(is_sky, np.inf, target.depth_of(points))
        return view.way_to(target, points, is_sky), depth

    def _read(self, index: int) -> tuple[Truth, View]:
        truth = read_truth_frame(self._dataset, index)
        header = read_attributes(self._dataset.exposed_truth(index))
        return truth, View.of(self._dataset.configuration.camera, header)

    def _check(self, *frames: int) -> None:
        count = self._dataset.configuration.trajectory.frames
        for frame in frames:
            if not 0 <= frame < count:
                raise UserError(f"frame {frame}: the sequence has frames 0 to {count - 1}")
