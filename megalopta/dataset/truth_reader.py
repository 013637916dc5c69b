"""Flow and occlusion between any two frames, of stored truth."""

from collections.abc import Mapping
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.errors import UserError
from megalopta.dataset.frames import read_truth_frame
from megalopta.dataset.reprojection import View, carried_points, motions_of
from megalopta.dataset.store import Dataset
from megalopta.render import Truth, out_of_view, read_attributes
from megalopta.scenes.motion import Motion

_KEPT = 4
_BEHIND = 1.01
"""A point is hidden where all that the other frame sees around it is nearer by this factor."""


class _Seen(NamedTuple):
    truth: Truth
    view: View


class TruthReader:
    """Truth of the frames of one sequence; some are kept."""

    def __init__(self, dataset: Dataset) -> None:
        self._dataset = dataset
        self._frame = lru_cache(maxsize=_KEPT)(self._read)

    def frame(self, index: int) -> Truth:
        """Truth of a frame. Raises UserError."""
        return self._frame(index).truth

    def flow(self, first: int, second: int) -> NDArray[np.float32]:
        """Flow (H, W, 2), px, from a frame to another."""
        self._check(first, second)
        if second == first + 1:
            return self.frame(first).flow_forward
        if second == first - 1:
            return self.frame(first).flow_backward
        return self._flow_and_depth(first, second)[0].astype(np.float32)

    def occlusion(self, first: int, second: int) -> NDArray[np.bool_]:
        """Where pixels (H, W) of a frame are hidden in another, or out of its view."""
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

    def _flow_and_depth(
        self, first: int, second: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Flow to another frame, and the depth (H, W) that its points have there."""
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
    flow: NDArray[np.float64],
    depth: NDArray[np.float64],
    seen: NDArray[np.float32],
    wraps: bool,
) -> NDArray[np.bool_]:
    """Where points at a depth (H, W) lie behind what is seen in all four pixels around them."""
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
