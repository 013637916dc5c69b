"""Poisson flow (PF): the flow of a whole frame by the likelihood of its counts, and smoothness.

All blocks share their evidence (`flow.likelihood`), where Poisson matching asks each alone. A
block's velocity is the mean of the flow over it. Motion that differs by some 10 px between large
parts of the picture is smoothed away, and so are small fast objects: a lower `smoothness` finds
them and errs more elsewhere.
"""

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from megalopta.flow.detectors.base import FloatArray, Frames, Responder, check_finite
from megalopta.flow.detectors.block_detector import BlockDetector
from megalopta.flow.detectors.dense_detector import mean_over_blocks
from megalopta.flow.likelihood import likelihood_flow


class PoissonFlow(BlockDetector, frozen=True):
    """Dense flow by the likelihood of counts in two frames, averaged over blocks."""

    place: ClassVar[float] = 14
    ignores_offset: ClassVar[bool] = False
    takes_counts: ClassVar[bool] = True

    name: str = "PF"
    """Short name"""

    label: str = "Poisson flow"
    """Name in words"""

    smoothness: Annotated[float, Field(gt=0)] = 0.2
    """Log-likelihood that a pixel's worth of flow is charged per unit of its gradient"""

    def dense(self, *frames: Frames) -> FloatArray:
        """Return the flow (H, W, 2), px per frame, at the first frame of the pair in the middle.

        Parameters
        ----------
        *frames : (H, W)
            Counts, two or more frames of one steady motion; without photons the flow is NaN.
        """
        check_finite(*frames)
        return likelihood_flow(np.stack(frames), self.smoothness)

    def start(self, shape: tuple[int, int]) -> Responder:
        """Return the estimator for frames (H, W); see `Detector.start`."""
        grid = self.grid(shape)
        return self.over_window(
            grid, lambda window, scale: mean_over_blocks(self.dense(*window), grid)
        )
