"""No motion at all: what every other method must beat."""

from typing import ClassVar

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.gray_detector import DenseDetector


class ZeroMotion(DenseDetector, frozen=True):
    """Flow of zero at every pixel."""

    place: ClassVar[float] = 16
    name: str = "zero"
    label: str = "No motion"

    def _flow(self, grid: BlockGrid, _: Floats) -> Floats:
        return np.zeros((*grid.shape, 2))
