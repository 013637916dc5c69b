from .benchmark import (
    BenchmarkResult as BenchmarkResult,
    BenchmarkSettings as BenchmarkSettings,
    Clip as Clip,
    SearchSettings as SearchSettings,
    photon_benchmark as photon_benchmark,
    photon_search as photon_search,
)
from .detectors import (
    METHODS as METHODS,
    BlockDetector as BlockDetector,
    BlockGrid as BlockGrid,
    DenseDetector as DenseDetector,
    Detector as Detector,
    IntensityMeasurement as IntensityMeasurement,
    Method as Method,
    NonDirectionalMultiplication as NonDirectionalMultiplication,
    NonDirectionalSummation as NonDirectionalSummation,
    block_grid as block_grid,
    detector_from as detector_from,
    method as method,
    summed_frames as summed_frames,
)
from .detectors.block_matching import BlockMatching as BlockMatching
from .detectors.burst_alignment import BurstAlignment as BurstAlignment
from .detectors.correlation import ElementaryMotionDetector as ElementaryMotionDetector
from .detectors.image_interpolation import ImageInterpolation as ImageInterpolation
from .detectors.opencv import (
    DenseInverseSearch as DenseInverseSearch,
    Farneback as Farneback,
    LucasKanade as LucasKanade,
)
from .detectors.poisson_flow import PoissonFlow as PoissonFlow, PooledFlow as PooledFlow
from .detectors.poisson_matching import PoissonMatching as PoissonMatching
from .detectors.pooled_matching import PooledMatching as PooledMatching
from .detectors.scikit_image import (
    PhaseCorrelation as PhaseCorrelation,
    TotalVariation as TotalVariation,
)
from .egomotion import (
    CameraMotion as CameraMotion,
    fit_wide_field as fit_wide_field,
    likely_camera_motion as likely_camera_motion,
)
from .egomotion.wide_field import WideField as WideField
from .files import (
    flow_to_rgb as flow_to_rgb,
    read_flow as read_flow,
    wheel_legend as wheel_legend,
    write_flo as write_flo,
)
from .metrics import (
    DenseErrors as DenseErrors,
    ErrorCurve as ErrorCurve,
    Metric as Metric,
    Threshold as Threshold,
    block_flow as block_flow,
    cramer_rao_covariance as cramer_rao_covariance,
    d_prime as d_prime,
    fisher_information as fisher_information,
    motion_evidence as motion_evidence,
    rightward_evidence as rightward_evidence,
    roc as roc,
    texture_spectrum as texture_spectrum,
    truth_error as truth_error,
    unknown_texture_photons as unknown_texture_photons,
)
from .metrics.endpoint_error import TruthError as TruthError
from .metrics.photon_threshold import threshold as threshold
from .one_call import optical_flow as optical_flow
from .stimuli import (
    Layer as Layer,
    MovingLayers as MovingLayers,
    MovingTemplate as MovingTemplate,
    Normalization as Normalization,
    ResizeKind as ResizeKind,
    draw_counts as draw_counts,
    resize as resize,
)
from .stimuli.resizing import triangular_pool as triangular_pool
