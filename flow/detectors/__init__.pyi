from .base import Detector, FloatArray, Frames
from .block_detector import BlockDetector
from .blocks import BlockGrid, block_grid, block_sums
from .correlation import NonDirectionalMultiplication, NonDirectionalSummation
from .dense_detector import DenseDetector
from .from_function import DenseFlow, detector_from
from .gray_detector import GrayDetector
from .intensity import IntensityMeasurement
from .registry import METHODS, THESIS_METHODS, Method, method
from .sinusoid_response import ndm_mean, nds_mean

__all__ = [
    "METHODS",
    "THESIS_METHODS",
    "BlockDetector",
    "BlockGrid",
    "DenseDetector",
    "DenseFlow",
    "Detector",
    "FloatArray",
    "Frames",
    "GrayDetector",
    "IntensityMeasurement",
    "Method",
    "NonDirectionalMultiplication",
    "NonDirectionalSummation",
    "block_grid",
    "block_sums",
    "detector_from",
    "method",
    "ndm_mean",
    "nds_mean",
]
