from .base import (
    Detector as Detector,
    FloatArray as FloatArray,
    Frames as Frames,
    Responder as Responder,
)
from .block_detector import BlockDetector as BlockDetector
from .blocks import (
    BlockGrid as BlockGrid,
    block_grid as block_grid,
    block_sums as block_sums,
)
from .correlation import (
    NonDirectionalMultiplication as NonDirectionalMultiplication,
    NonDirectionalSummation as NonDirectionalSummation,
)
from .dense_detector import DenseDetector as DenseDetector
from .from_function import (
    DenseFlow as DenseFlow,
    detector_from as detector_from,
)
from .from_reference import detector_at as detector_at
from .gray_detector import GrayDetector as GrayDetector
from .intensity import IntensityMeasurement as IntensityMeasurement
from .onnx_detector import OnnxDetector as OnnxDetector
from .registry import (
    METHODS as METHODS,
    THESIS_METHODS as THESIS_METHODS,
    Method as Method,
    method as method,
)
from .sinusoid_response import (
    ndm_mean as ndm_mean,
    nds_mean as nds_mean,
)
from .summed_frames import (
    SummedFrames as SummedFrames,
    summed_frames as summed_frames,
)
