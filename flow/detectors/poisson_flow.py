"""Poisson flow: the flow of a whole frame by the likelihood of its counts, of two frames or eight.

All blocks share their evidence (`flow.likelihood`), unlike Poisson matching. A block's velocity is
the mean of the flow over it.
"""

import math
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from megalopta.core.arrays import Floats, Mask
from megalopta.flow.detectors.base import Frames
from megalopta.flow.detectors.blocks import BlockDetector, BlockGrid, PooledFrames, mean_over_blocks
from megalopta.flow.detectors.libraries import DenseInverseSearch
from megalopta.flow.likelihood import dense_flow
from megalopta.flow.likelihood.alignment import round_trip

_DIS = DenseInverseSearch(stretch="anscombe", blur_px=0.7)
_OCCLUDED_PX, _OCCLUDED_SHARE = 2.0, 0.2
"""Distance after the way there and back above which a pixel is occluded, and share of its motion"""


class _FlowOfCounts(BlockDetector, frozen=True):
    ignores_offset: ClassVar[bool] = False
    takes_counts: ClassVar[bool] = True

    def velocities(self, grid: BlockGrid, window: list[Frames]) -> Floats:
        """Return the means of the flow over blocks."""
        return mean_over_blocks(self.dense(*window), grid)

    def prepared(self, grid: BlockGrid, frame: Frames) -> Frames:
        """Return a copy of a frame, for `dense`."""
        return frame.copy()

    def _smoothness(self, smoothness: float, counts: Frames) -> float:
        """Return a smoothness for as many photons as tell as much as counts with a dark part."""
        light = max(1 - self.dark_counts / float(counts.mean() or 1), 0.01)  # at least 1 % is light
        return float(smoothness * light ** (2 * dense_flow.SMOOTHNESS_POWER))


class PoissonFlow(_FlowOfCounts, frozen=True):
    """Dense flow by the likelihood of counts in two frames, averaged over blocks."""

    place: ClassVar[float] = 14

    name: str = "PF"
    label: str = "Poisson flow"
    smoothness: Annotated[float, Field(gt=0)] = 0.2
    """Penalty in log-likelihood per pixel and unit of the flow's gradient, at 20 photons in all"""

    @property
    def most_frames(self) -> float:
        """Any number, of one steady motion."""
        return math.inf

    def dense(self, *frames: Frames) -> Floats:
        """Return the flow (H, W, 2), px per frame, at the first frame of the pair in the middle.

        NaN if a frame has no photon. Raises ValueError if they differ in shape, or are not counts.
        """
        counts = self.as_counts(self.checked(frames))
        return dense_flow.likelihood_flow(
            counts, self._smoothness(self.smoothness, counts), _proposal(counts)
        )

    def dense_with_covariance(self, *frames: Frames) -> tuple[Floats, Floats]:
        """Return the flow as `dense` does, and its covariances (H, W, 2, 2), px² per frame²."""
        counts = self.as_counts(self.checked(frames))
        return dense_flow.flow_and_covariance(
            counts, self._smoothness(self.smoothness, counts), _proposal(counts)
        )

    def dense_with_occlusion(self, *frames: Frames) -> tuple[Floats, Mask]:
        """Return the flow as `dense` does, and which pixels (H, W) the second frame does not show.

        Those from which the flow and that of the frames in reverse order do not lead back, or that
        leave the frame.
        """
        flow, back = self.dense(*frames), self.dense(*frames[: len(frames) // 2 * 2][::-1])
        distance = round_trip(np.moveaxis(flow, -1, 0), np.moveaxis(back, -1, 0))
        speed = np.hypot(flow[..., 0], flow[..., 1])
        return flow, distance > _OCCLUDED_PX + _OCCLUDED_SHARE * speed


def _proposal(counts: Frames) -> tuple[Floats, Floats]:
    """Return the flow of DIS between the two frames in the middle of counts, and back."""
    pair = counts[len(counts) // 2 - 1 : len(counts) // 2 + 1]
    return np.moveaxis(_DIS.dense(*pair), -1, 0), np.moveaxis(_DIS.dense(*pair[::-1]), -1, 0)


class PooledFlow(PooledFrames, PoissonFlow, frozen=True):
    """Dense flow by the likelihood of counts in several frames, averaged over blocks.

    All pairs of the frames count at once: the sum of the squares of aligned roots from their mean
    is, up to a factor, that over all pairs. The flow is that of the middle of the frames, assuming
    no acceleration; at the start of a sequence there are fewer frames.
    """

    place: ClassVar[float] = 15
    name: str = "PPF"
    label: str = "Pooled Poisson flow"


class FastPoissonFlow(_FlowOfCounts, frozen=True):
    """Dense flow by DIS and one step of the likelihood of counts, averaged over blocks.

    DIS finds the flow on Anscombe's root of the counts, blurred slightly. One Newton step of
    Poisson flow refines it on frames binned by 2 × 2 px. It sees no motion that DIS misses.
    """

    place: ClassVar[float] = 14.5

    name: str = "PF-fast"
    label: str = "Fast Poisson flow"

    def dense(self, *frames: Frames) -> Floats:
        """Return the flow (H, W, 2) from one frame to the next, px; NaN if one has no photon."""
        pair = self.as_counts(self.checked(frames))
        start = np.nan_to_num(_DIS.dense(*pair))  # NaN without contrast
        return dense_flow.refined_flow(pair, start, PoissonFlow().smoothness)
