"""One shift for the whole frame, from the phase of its spectrum."""

from typing import ClassVar

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.gray_detector import DenseDetector


class OneShift(DenseDetector, frozen=True):
    """The shift of the whole frame, by OpenCV's phase correlation."""

    place: ClassVar[float] = 20
    name: str = "OS"
    label: str = "one shift of the whole frame"

    def _flow(self, grid: BlockGrid, pair: Floats) -> Floats:
        import cv2

        shift, _ = cv2.phaseCorrelate(pair[0], pair[1])
        return np.broadcast_to(shift, (*grid.shape, 2))
