"""Estimators of OpenCV, its contributed modules, and scikit-image.

OpenCV runs on one thread: its parallel loops cut a frame by the number of threads, and some
estimators propagate results within such a part, so only one thread gives the same numbers on every
machine.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.gray_detector import DenseDetector, GrayDetector, eight_bits

_lock, _threads = Lock(), list[int]()
"""OpenCV's number of threads, global in a process, before each caller that is on one thread"""


class LucasKanade(GrayDetector, frozen=True):
    """Newton search for the shift of a window around the center of each block, coarse to fine.

    Bouguet's iterative form, by Newton steps from the coarsest level of a pyramid down. Levels see
    2, 4, … times as far; if the texture repeats after a few pixels, they may start the finest in
    the wrong period. With `pyramid_levels` 1 an estimate uses the photons of its window alone.

    A window whose gradients have one direction only, or none, or that was tracked out of the frame,
    has no velocity (NaN).
    """

    place: ClassVar[float] = 7
    name: str = "LK"
    label: str = "Lucas–Kanade, pyramidal"
    window_blocks: Annotated[float, Field(gt=0)] = 1.0
    """Side of the window in sides of a block; 1: exactly the block's pixels"""
    pyramid_levels: Annotated[int, Field(ge=1)] = 3
    """Largest number of levels, including the frames themselves; 1: no pyramid"""

    def _estimate(self, grid: BlockGrid, pair: Floats) -> Floats:
        import cv2

        side = max(3, round(self.window_blocks * grid.block_px))
        centers = (grid.centers.reshape(-1, 2) - 0.5).astype(np.float32)
        tracker: Any = cv2.SparsePyrLKOpticalFlow.create((side, side), self.pyramid_levels - 1)
        with one_thread():
            tracked, status, _ = tracker.calc(*eight_bits(pair), centers, np.empty_like(centers))
        moved = np.where(status > 0, tracked - centers, np.nan)
        return moved.reshape(grid.rows, grid.columns, 2).astype(np.float64)


class Farneback(DenseDetector, frozen=True):
    """Dense flow from local quadratic polynomials (Farnebäck 2003), averaged over blocks.

    Around each pixel both frames are approximated by quadratic polynomials; how their linear terms
    differ gives the shift, by least squares over a window. Without texture the flow tends to 0.
    Right and lower neighbors beyond the frame count as unmatched texture.
    """

    place: ClassVar[float] = 8
    name: str = "FB"
    label: str = "Farnebäck"
    window_blocks: Annotated[float, Field(gt=0)] = 1.0
    """Side of the averaging window in sides of a block"""

    def _flow(self, grid: BlockGrid, pair: Floats) -> NDArray[Any]:
        import cv2

        window = max(1, round(self.window_blocks * grid.block_px))
        # its regularization is an absolute number, for 8-bit pictures
        estimator = cv2.FarnebackOpticalFlow.create(numLevels=3, winSize=window, numIters=3)
        return _calculated(estimator, (255 * pair).astype(np.float32))


class DenseInverseSearch(DenseDetector, frozen=True):
    """Dense flow from overlapping tracked patches (Kroeger et al. 2016), averaged over blocks.

    Patches of 8 × 8 px are tracked by the inverse Lucas–Kanade search, coarse to fine; each pixel
    averages the patches that cover it, and a variational refinement smooths the result and fills
    gaps in the texture from around them.
    """

    place: ClassVar[float] = 9
    name: str = "DIS"
    label: str = "Dense inverse search"
    preset: Literal["ultrafast", "fast", "medium"] = "medium"
    """OpenCV's trade-off of speed and accuracy"""

    def _flow(self, _: BlockGrid, pair: Floats) -> NDArray[Any]:
        import cv2

        preset = getattr(cv2, f"DISOPTICAL_FLOW_PRESET_{self.preset.upper()}")
        return _calculated(cv2.DISOpticalFlow.create(preset), eight_bits(pair), 12)


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep OpenCV on one thread until the last of the callers leaves."""
    import cv2

    with _lock:
        _threads.append(cv2.getNumThreads())
        cv2.setNumThreads(1)
    try:
        yield
    finally:
        with _lock:
            cv2.setNumThreads(_threads.pop())


class TotalVariation(DenseDetector, frozen=True):
    """Dense flow smoothed by its total variation (TV-L1), averaged over blocks.

    The flow that minimizes the absolute difference of the frames plus the total variation of the
    flow itself, coarse to fine (Zach, Pock and Bischof 2007). The second term carries the flow over
    places without texture, and lets neighboring blocks share their photons.
    """

    place: ClassVar[float] = 10
    name: str = "TV-L1"
    label: str = "Total variation"
    attachment: Annotated[float, Field(gt=0)] = 15.0
    """Weight of the frames' difference, gray levels from 0 to 1; smaller gives smoother flow"""

    def _flow(self, grid: BlockGrid, pair: Floats) -> Floats:
        from skimage.registration import optical_flow_tvl1

        down_right = optical_flow_tvl1(*pair, attachment=self.attachment, dtype=np.float64)
        return np.moveaxis(down_right[::-1], 0, -1)


class DualTotalVariation(DenseDetector, frozen=True):
    """Dense flow smoothed by its total variation, by OpenCV, averaged over blocks.

    As `TotalVariation`, with a median filter after every warp (Sánchez, Meinhardt-Llopis and
    Facciolo 2013).
    """

    place: ClassVar[float] = 10.2
    name: str = "DualTVL1"
    label: str = "Total variation, OpenCV"
    attachment: Annotated[float, Field(gt=0)] = 0.06
    """Weight of the frames' difference, gray levels from 0 to 255; smaller gives smoother flow.
    OpenCV's 0.15 suits pictures without noise"""

    def _flow(self, _: BlockGrid, pair: Floats) -> NDArray[Any]:
        import cv2

        estimator = cv2.optflow.DualTVL1OpticalFlow.create(lambda_=self.attachment)
        return _calculated(estimator, pair.astype(np.float32))


class DeepFlow(DenseDetector, frozen=True):
    """Dense flow of constant brightness and gradients, averaged over blocks.

    The variational part of DeepFlow (Weinzaepfel et al. 2013; Brox et al. 2004), coarse to fine,
    without its matches of descriptors. Its weights are fixed by OpenCV.
    """

    place: ClassVar[float] = 10.3
    name: str = "DeepFlow"
    label: str = "DeepFlow, variational"

    def _flow(self, _: BlockGrid, pair: Floats) -> NDArray[Any]:
        import cv2

        return _calculated(cv2.optflow.createOptFlow_DeepFlow(), (255 * pair).astype(np.float32))


class PCAFlow(DenseDetector, frozen=True):
    """Dense flow as a sum of smooth basis fields (Wulff and Black 2015), averaged over blocks.

    Their weights are those that fit tracked corners best, so the flow has no edges. A pair without
    corners has no velocity (NaN).
    """

    place: ClassVar[float] = 10.6
    name: str = "PCAFlow"
    label: str = "PCA-Flow"

    def _flow(self, grid: BlockGrid, pair: Floats) -> NDArray[Any]:
        import cv2

        try:
            return _calculated(cv2.optflow.createOptFlow_PCAFlow(), eight_bits(pair), 128)
        except cv2.error:  # no corner was tracked
            return np.full((*grid.shape, 2), np.nan)


class RobustLocalFlow(DenseDetector, frozen=True):
    """Dense flow between tracked points (RLOF, Senst et al. 2012), averaged over blocks.

    Points of a grid of 6 px are tracked with a robust norm, and the flow between them is
    interpolated within edges (Geistert et al. 2016). Two steps of OpenCV's are omitted, for few
    points: the prior of a global motion never ends, and the check of the way back leaves fewer
    neighbors than are read.
    """

    place: ClassVar[float] = 10.7
    name: str = "RLOF"
    label: str = "Robust local flow"
    window_px: Annotated[int, Field(ge=5, le=99)] | None = None
    """Side of the window of a point; default: 9 to 21 px, cut where gray levels change"""

    def _flow(self, _: BlockGrid, pair: Floats) -> NDArray[Any]:
        import cv2

        tracking = cv2.optflow.RLOFOpticalFlowParameter.create()
        tracking.setUseGlobalMotionPrior(False)
        if self.window_px is not None:
            tracking.setSupportRegionType(cv2.optflow.SR_FIXED)
            tracking.setLargeWinSize(self.window_px)
        between = cv2.optflow.DenseRLOFOpticalFlow.create(tracking, forwardBackwardThreshold=0)
        in_color = np.repeat(eight_bits(pair)[..., np.newaxis], 3, axis=-1)
        return _calculated(between, in_color, 128)


def _calculated(estimator: Any, pictures: NDArray[Any], fewest_px: int = 1) -> NDArray[Any]:
    """Return the flow (H, W, 2) by an estimator of OpenCV between two pictures, on one thread.

    Sides with fewer pixels are padded: estimators go beyond the memory of small pictures.
    """
    height, width = pictures.shape[1:3]
    more = [(0, 0), *((0, max(0, fewest_px - side)) for side in (height, width)), (0, 0)]
    padded = np.pad(pictures, more[: pictures.ndim], mode="edge")
    with one_thread():
        start = np.zeros((*padded.shape[1:3], 2), np.float32)
        return np.asarray(estimator.calc(*padded, start))[:height, :width]


class DenseLucasKanade(DenseDetector, frozen=True):
    """Lucas–Kanade around each pixel (Le Besnerais and Champagnat 2005), averaged over blocks.

    The second frame is warped by the flow so far, and the shift that remains is solved in a square
    window around each pixel, coarse to fine. A window without texture keeps the flow of the coarser
    level, so no block lacks a velocity.
    """

    place: ClassVar[float] = 10.5
    name: str = "ILK"
    label: str = "Lucas–Kanade, dense"
    window_blocks: Annotated[float, Field(gt=0)] = 1.0
    """Side of the window in sides of a block"""

    def _flow(self, grid: BlockGrid, pair: Floats) -> Floats:
        from skimage.registration import optical_flow_ilk

        radius = max(1, round(self.window_blocks * grid.block_px / 2))
        return np.moveaxis(optical_flow_ilk(*pair, radius=radius, dtype=np.float64)[::-1], 0, -1)


class PhaseCorrelation(GrayDetector, frozen=True):
    """The one shift of the whole frame, given to every block.

    The cross-power spectrum of two frames, whitened so that all spatial frequencies weigh the same,
    is the phase ramp of their shift; its transform peaks there (Kuglin and Hines 1975), refined on
    a finer grid around the peak (Guizar-Sicairos et al. 2008). Frames lose their mean and fade to
    zero at the edges, since the transform assumes that they are periodic. Whitening gives full
    weight to frequencies that contain only photon noise.
    """

    place: ClassVar[float] = 11
    name: str = "PC"
    label: str = "Phase correlation, global"

    def _estimate(self, grid: BlockGrid, pair: Floats) -> Floats:
        from scipy.signal.windows import tukey
        from skimage.registration import phase_cross_correlation

        window = np.outer(*(tukey(side, 0.5) for side in grid.shape))
        faded = (window * (frame - frame.mean()) for frame in pair)
        # The returned shift, in steps of 1/20 px, registers the second frame to the first.
        shift, *_ = phase_cross_correlation(*faded, upsample_factor=20, normalization="phase")
        return np.broadcast_to(-shift[::-1], (grid.rows, grid.columns, 2))
