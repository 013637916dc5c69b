from .benchmark import (
    BenchmarkResult as BenchmarkResult,
    BenchmarkSettings as BenchmarkSettings,
    SearchSettings as SearchSettings,
    photon_benchmark as photon_benchmark,
)
from .benchmark_search import photon_search as photon_search
from .camera_motion import (
    CameraMotion as CameraMotion,
    CameraMotionError as CameraMotionError,
    camera_motion_with_error as camera_motion_with_error,
    likely_camera_motion as likely_camera_motion,
)
from .color_wheel import flow_to_rgb as flow_to_rgb, wheel_legend as wheel_legend
from .detectors.base import Detector as Detector
from .detectors.block_matching import BlockMatching as BlockMatching
from .detectors.blocks import (
    BlockDetector as BlockDetector,
    BlockGrid as BlockGrid,
    block_grid as block_grid,
    summed_frames as summed_frames,
)
from .detectors.burst_alignment import BurstAlignment as BurstAlignment
from .detectors.correlation import (
    ElementaryMotionDetector as ElementaryMotionDetector,
    NonDirectionalMultiplication as NonDirectionalMultiplication,
    NonDirectionalSummation as NonDirectionalSummation,
    ndm_mean as ndm_mean,
    nds_mean as nds_mean,
)
from .detectors.gray_detector import DenseDetector as DenseDetector, detector_from as detector_from
from .detectors.image_interpolation import ImageInterpolation as ImageInterpolation
from .detectors.intensity import IntensityMeasurement as IntensityMeasurement
from .detectors.libraries import (
    DenseInverseSearch as DenseInverseSearch,
    Farneback as Farneback,
    LucasKanade as LucasKanade,
    PhaseCorrelation as PhaseCorrelation,
    TotalVariation as TotalVariation,
)
from .detectors.poisson_flow import PoissonFlow as PoissonFlow, PooledFlow as PooledFlow
from .detectors.poisson_matching import (
    PoissonMatching as PoissonMatching,
    PooledMatching as PooledMatching,
)
from .detectors.registry import METHODS as METHODS, Method as Method, method as method
from .formats import read_flow as read_flow, write_flo as write_flo
from .metrics.endpoint_error import (
    DenseErrors as DenseErrors,
    TruthError as TruthError,
    ause as ause,
    block_flow as block_flow,
    truth_error as truth_error,
)
from .metrics.photon_threshold import (
    ErrorCurve as ErrorCurve,
    Threshold as Threshold,
    threshold as threshold,
)
from .metrics.response_error import Metric as Metric
from .metrics.translation_bound import (
    cramer_rao_covariance as cramer_rao_covariance,
    fisher_information as fisher_information,
    texture_spectrum as texture_spectrum,
    unknown_texture_photons as unknown_texture_photons,
)
from .one_call import event_flow as event_flow, optical_flow as optical_flow
from .stimuli.known_flow import Layer as Layer, MovingLayers as MovingLayers
from .stimuli.moving_template import MovingTemplate as MovingTemplate
from .stimuli.photons import (
    ResizeKind as ResizeKind,
    draw_counts as draw_counts,
    resize as resize,
    triangular_pool as triangular_pool,
)
