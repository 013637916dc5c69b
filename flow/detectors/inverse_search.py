"""Dense inverse search (DIS), from OpenCV, averaged over blocks.

Overlapping patches of 8 × 8 px are tracked by the inverse Lucas–Kanade search, coarse to fine; each
pixel averages the patches that cover it, and a variational refinement smooths the result (Kroeger
et al. 2016). The preset sets how many patches, steps and levels; all of them stop one or two levels
above the frames. It fills gaps in the texture from around them, so no block lacks a velocity.
"""

from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from megalopta.flow.detectors.base import FloatArray
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.dense_detector import DenseDetector, PairFlow
from megalopta.flow.detectors.gray_detector import eight_bits
from megalopta.flow.detectors.opencv import one_thread

_SMALLEST_FRAME_PX = 12

Preset = Literal["ultrafast", "fast", "medium"]


class DenseInverseSearch(DenseDetector, frozen=True):
    """Dense flow from overlapping tracked patches, averaged over blocks."""

    place: ClassVar[float] = 9

    name: str = "DIS"
    """Short name"""

    label: str = "Dense inverse search"
    """Name in words"""

    preset: Preset = "medium"
    """OpenCV's choice between speed and accuracy"""

    def _dense(self, grid: BlockGrid) -> PairFlow:
        import cv2

        height, width = grid.shape
        if max(grid.shape) < _SMALLEST_FRAME_PX:
            raise ValueError(
                f"frames of {height} × {width} px: {self.name} needs at least"
                f" {_SMALLEST_FRAME_PX} px along one side"
            )
        search = cv2.DISOpticalFlow.create(_presets()[self.preset])

        def flow(pair: FloatArray) -> NDArray[Any]:
            first, second = eight_bits(pair)
            with one_thread():
                return search.calc(first, second, np.zeros((*grid.shape, 2), np.float32))

        return flow


def _presets() -> dict[Preset, int]:
    import cv2

    return {
        "ultrafast": cv2.DISOPTICAL_FLOW_PRESET_ULTRAFAST,
        "fast": cv2.DISOPTICAL_FLOW_PRESET_FAST,
        "medium": cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
    }
