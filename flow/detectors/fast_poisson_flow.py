"""Fast Poisson flow (PF-fast): DIS, and one step of the likelihood.

DIS finds the flow on Anscombe's root of the counts, blurred slightly. One Newton step of Poisson
flow, with its prior, refines it on frames binned by 2 × 2 px. It sees no motion that DIS misses,
finds no hot pixels, and states no uncertainty. Measured in `docs/theory/whole-frame-flow.md`.
"""

from typing import ClassVar

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.flow.detectors.base import Frames, stacked
from megalopta.flow.detectors.blocks import BlockDetector, BlockGrid, mean_over_blocks
from megalopta.flow.detectors.libraries import DenseInverseSearch
from megalopta.flow.detectors.poisson_flow import PoissonFlow
from megalopta.flow.likely_flow import refined_flow

_START = DenseInverseSearch(stretch="anscombe", blur_px=0.7)
_SMOOTHNESS = PoissonFlow().smoothness
_SMALLEST_PX = 12


class FastPoissonFlow(BlockDetector, frozen=True):
    """Dense flow by DIS and one step of the likelihood of counts, averaged over blocks."""

    place: ClassVar[float] = 14.5
    ignores_offset: ClassVar[bool] = False
    takes_counts: ClassVar[bool] = True

    name: str = "PF-fast"
    label: str = "Fast Poisson flow"

    def grid(self, shape: tuple[int, int]) -> BlockGrid:
        """Return the blocks of a frame (H, W); ValueError if it is too small."""
        if min(shape) < _SMALLEST_PX:
            raise ValueError(
                f"frames of {shape[0]} × {shape[1]} px: {self.name} needs at least"
                f" {_SMALLEST_PX} px along each side"
            )
        return super().grid(shape)

    def dense(self, *frames: Frames) -> Floats:
        """Return the flow (H, W, 2) from one frame to the next, px; NaN without photons.

        Raises as `BlockDetector.dense`.
        """
        pair = self.checked(frames)
        self.grid((pair.shape[1], pair.shape[2]))
        return _flow(pair)

    def velocities(self, grid: BlockGrid, window: list[Frames]) -> Floats:
        """Return the means of the flow over blocks."""
        return mean_over_blocks(_flow(stacked(window)), grid)


def _flow(pair: Frames) -> Floats:
    # NaN without contrast
    return refined_flow(pair, np.nan_to_num(_START.dense(*pair)), _SMOOTHNESS)
