from .benchmark.result import BenchmarkResult as BenchmarkResult
from .benchmark.search import photon_search as photon_search
from .benchmark.sequence import photon_benchmark as photon_benchmark
from .benchmark.settings import (
    BenchmarkSettings as BenchmarkSettings,
    SearchSettings as SearchSettings,
)
from .detectors.base import Detector as Detector
from .detectors.block_detector import BlockDetector as BlockDetector
from .detectors.dense_detector import DenseDetector as DenseDetector
from .detectors.from_function import detector_from as detector_from
from .detectors.registry import (
    METHODS as METHODS,
    THESIS_METHODS as THESIS_METHODS,
    Method as Method,
    method as method,
)
from .egomotion.wide_field import (
    WideField as WideField,
    fit_wide_field as fit_wide_field,
)
from .files.color_wheel import (
    flow_to_rgb as flow_to_rgb,
    wheel_legend as wheel_legend,
)
from .files.flo import (
    read_flo as read_flo,
    write_flo as write_flo,
)
from .metrics.curve import ErrorCurve as ErrorCurve
from .metrics.detection import (
    d_prime as d_prime,
    motion_evidence as motion_evidence,
    rightward_evidence as rightward_evidence,
    roc as roc,
)
from .metrics.endpoint_error import (
    TruthError as TruthError,
    block_flow as block_flow,
    block_share as block_share,
    truth_error as truth_error,
)
from .metrics.photon_threshold import (
    Threshold as Threshold,
    threshold as threshold,
)
from .metrics.response_error import (
    ErrorSums as ErrorSums,
    error_sums as error_sums,
)
from .metrics.splits import truth_splits as truth_splits
from .metrics.translation_bound import (
    cramer_rao_covariance as cramer_rao_covariance,
    fisher_information as fisher_information,
)
from .metrics.unknown_texture import (
    texture_spectrum as texture_spectrum,
    unknown_texture_information as unknown_texture_information,
    unknown_texture_photons as unknown_texture_photons,
)
from .stimuli.moving_template import MovingTemplate as MovingTemplate
from .stimuli.photons import draw_counts as draw_counts
from .stimuli.resizing import resize as resize
from .stimuli.triangular_pooling import triangular_pool as triangular_pool
