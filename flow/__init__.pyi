from .benchmark.result import BenchmarkResult
from .benchmark.search import photon_search
from .benchmark.sequence import photon_benchmark
from .benchmark.settings import BenchmarkSettings, SearchSettings
from .detectors.base import Detector
from .detectors.block_detector import BlockDetector
from .detectors.dense_detector import DenseDetector
from .detectors.from_function import detector_from
from .detectors.registry import METHODS, THESIS_METHODS, Method, method
from .egomotion.wide_field import WideField, fit_wide_field
from .files.color_wheel import flow_to_rgb, wheel_legend
from .files.flo import read_flo, write_flo
from .metrics.curve import ErrorCurve
from .metrics.detection import d_prime, motion_evidence, rightward_evidence, roc
from .metrics.endpoint_error import TruthError, block_flow, block_share, truth_error
from .metrics.photon_threshold import Threshold, threshold
from .metrics.response_error import ErrorSums, error_sums
from .metrics.splits import truth_splits
from .metrics.translation_bound import cramer_rao_covariance, fisher_information
from .stimuli.moving_template import MovingTemplate
from .stimuli.photons import draw_counts
from .stimuli.resizing import resize
from .stimuli.triangular_pooling import triangular_pool

__all__ = [
    "METHODS",
    "THESIS_METHODS",
    "BenchmarkResult",
    "BenchmarkSettings",
    "BlockDetector",
    "DenseDetector",
    "Detector",
    "ErrorCurve",
    "ErrorSums",
    "Method",
    "MovingTemplate",
    "SearchSettings",
    "Threshold",
    "TruthError",
    "WideField",
    "block_flow",
    "block_share",
    "cramer_rao_covariance",
    "d_prime",
    "detector_from",
    "draw_counts",
    "error_sums",
    "fisher_information",
    "fit_wide_field",
    "flow_to_rgb",
    "method",
    "motion_evidence",
    "photon_benchmark",
    "photon_search",
    "read_flo",
    "resize",
    "rightward_evidence",
    "roc",
    "threshold",
    "triangular_pool",
    "truth_error",
    "truth_splits",
    "wheel_legend",
    "write_flo",
]
