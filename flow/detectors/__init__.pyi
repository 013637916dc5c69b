from .base import Detector, FloatArray, Frames
from .block_detector import BlockDetector
from .blocks import BlockGrid, block_grid, block_sums
from .correlation import NonDirectionalMultiplication, NonDirectionalSummation
from .intensity import IntensityMeasurement
from .registry import METHODS, THESIS_METHODS, method
from .sinusoid_response import ndm_mean, nds_mean

__all__ = [
    "METHODS",
    "THESIS_METHODS",
    "BlockDetector",
    "BlockGrid",
    "Detector",
    "FloatArray",
    "Frames",
    "IntensityMeasurement",
    "NonDirectionalMultiplication",
    "NonDirectionalSummation",
    "block_grid",
    "block_sums",
    "method",
    "ndm_mean",
    "nds_mean",
]
