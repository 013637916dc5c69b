"""Estimators of OpenCV and scikit-image, and of OpenCV's contributed modules where installed.

OpenCV runs on one thread: its parallel loops cut a frame by the number of threads, and some
estimators propagate results within such a part, so only one thread gives the same numbers on every
machine.

RLOF: Senst et al. 2012, Geistert et al. 2016. PCAFlow: Wulff and Black 2015. DeepFlow: the
variational part, coarse to fine, without its matches (Weinzaepfel et al. 2013). They are in no
default list: an environment without them gives the same tables.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Annotated, Any, ClassVar, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.gray_detector import DenseDetector, GrayDetector, eight_bits

_SMALLEST_DIS_FRAME_PX = 12


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
        sides, coarsest = (side, side), self.pyramid_levels - 1
        first, second = eight_bits(pair)
        with one_thread():
            tracked, status, _ = cv2.calcOpticalFlowPyrLK(
                first, second, centers, np.empty_like(centers), winSize=sides, maxLevel=coarsest
            )
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
        # a neighborhood of 5 px, and the width of its weights recommended by OpenCV
        settings: dict[str, Any] = {"levels": 3, "winsize": window, "iterations": 3, "flags": 0}
        settings |= {"pyr_scale": 0.5, "poly_n": 5, "poly_sigma": 1.1}
        # its regularization is an absolute number, for 8-bit pictures
        first, second = (255 * pair).astype(np.float32)
        empty: Any = np.empty((*grid.shape, 2), np.float32)
        with one_thread():
            return np.asarray(cv2.calcOpticalFlowFarneback(first, second, empty, **settings))


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

    def grid(self, shape: tuple[int, int]) -> BlockGrid:
        """Return the blocks of a frame (H, W); ValueError if it is too small."""
        if max(shape) < _SMALLEST_DIS_FRAME_PX:
            raise ValueError(
                f"frames of {shape[0]} × {shape[1]} px: {self.name} needs at least"
                f" {_SMALLEST_DIS_FRAME_PX} px along one side"
            )
        return super().grid(shape)

    def _flow(self, grid: BlockGrid, pair: Floats) -> NDArray[Any]:
        import cv2

        preset = getattr(cv2, f"DISOPTICAL_FLOW_PRESET_{self.preset.upper()}")
        first, second = eight_bits(pair)
        start = np.zeros((*grid.shape, 2), np.float32)
        with one_thread():
            return cv2.DISOpticalFlow.create(preset).calc(first, second, start)


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep OpenCV on one thread until the last of nested callers leaves."""
    import cv2

    with _Callers.lock:
        if _Callers.inside == 0:
            _Callers.threads_before = cv2.getNumThreads()
            cv2.setNumThreads(1)
        _Callers.inside += 1
    try:
        yield
    finally:
        with _Callers.lock:
            _Callers.inside -= 1
            if _Callers.inside == 0:
                cv2.setNumThreads(_Callers.threads_before)


class _Callers:
    """Counts the callers on one thread: OpenCV's number of threads is global in a process."""

    lock = Lock()
    inside = 0
    threads_before = 1


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

        down, right = optical_flow_tvl1(*pair, attachment=self.attachment, dtype=np.float64)
        return np.stack((right, down), axis=-1)


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
        down, right = optical_flow_ilk(*pair, radius=radius, dtype=np.float64)
        return np.stack((right, down), axis=-1)


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
        first, second = (window * (frame - frame.mean()) for frame in pair)
        # The returned shift, in steps of 1/20 px, registers the second frame to the first.
        shift, *_ = phase_cross_correlation(
            first, second, upsample_factor=20, normalization="phase"
        )
        return np.broadcast_to(-shift[::-1], (grid.rows, grid.columns, 2))


Algorithm = Literal["RLOF", "PCAFlow", "DeepFlow"]
_REMEDY = "pip uninstall -y opencv-python-headless; pip install opencv-contrib-python-headless"


class ContribFlow(DenseDetector, frozen=True):
    """Dense flow of a contributed estimator with OpenCV's settings, averaged over blocks."""

    algorithm: Algorithm
    """Name of the estimator"""

    def _flow(self, _: BlockGrid, pair: Floats) -> NDArray[Any]:
        import cv2

        optflow = vars(cv2)["optflow"]  # unknown to the types of OpenCV without it
        first, second = eight_bits(pair)
        start = np.zeros((*pair.shape[1:], 2), np.float32)
        with one_thread():
            if self.algorithm == "RLOF":  # which takes colors
                colors = [cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR) for picture in (first, second)]
                return np.asarray(optflow.calcOpticalFlowDenseRLOF(*colors, start))
            create = getattr(optflow, f"createOptFlow_{self.algorithm}")
            return np.asarray(create().calc(first, second, start))


def contrib_detector(name: str) -> ContribFlow | None:
    """Return an estimator by name, upper or lower case; None for any other name.

    Raises ValueError if OpenCV comes without it.
    """
    known = {algorithm.casefold(): algorithm for algorithm in get_args(Algorithm)}
    if (algorithm := known.get(name.casefold())) is None:
        return None
    import cv2

    if not hasattr(cv2, "optflow"):
        raise ValueError(f"{algorithm} needs OpenCV's contributed modules; run: {_REMEDY}")
    return ContribFlow(name=algorithm, label=f"{algorithm}, OpenCV contrib", algorithm=algorithm)
