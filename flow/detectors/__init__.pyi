from .base import (
    Detector as Detector,
    FloatArray as FloatArray,
    Frames as Frames,
    Responder as Responder,
)
from .blocks import (
    BlockDetector as BlockDetector,
    BlockGrid as BlockGrid,
    block_grid as block_grid,
    block_sums as block_sums,
)
from .correlation import (
    NonDirectionalMultiplication as NonDirectionalMultiplication,
    NonDirectionalSummation as NonDirectionalSummation,
    ndm_mean as ndm_mean,
    nds_mean as nds_mean,
)
from .from_function import detector_from as detector_from
from .gray_detector import (
    DenseDetector as DenseDetector,
    GrayDetector as GrayDetector,
)
from .intensity import IntensityMeasurement as IntensityMeasurement
from .registry import (
    METHODS as METHODS,
    THESIS_METHODS as THESIS_METHODS,
    Method as Method,
    method as method,
)
from .summed_frames import summed_frames as summed_frames
