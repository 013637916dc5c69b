from .curve import ErrorCurve, error_curve
from .dense_error import GROUPS, DenseError, DenseErrors
from .detection import Roc, d_prime, false_alarm_rate, motion_evidence, rightward_evidence, roc
from .efficiency import (
    bound_photons,
    confined_velocities,
    is_within,
    photons_for_half,
    variance_efficiency,
)
from .endpoint_error import TruthError, block_flow, block_share, truth_error
from .photon_threshold import Threshold, format_flux
from .response_error import METRICS, ErrorSums, Metric, combine, error_sums
from .splits import FAST_PX, OCCLUDED_SHARE, SLOW_PX, truth_splits
from .translation_bound import (
    cramer_rao_covariance,
    cramer_rao_covariance_along_x,
    fisher_information,
)

__all__ = [
    "FAST_PX",
    "GROUPS",
    "METRICS",
    "OCCLUDED_SHARE",
    "SLOW_PX",
    "DenseError",
    "DenseErrors",
    "ErrorCurve",
    "ErrorSums",
    "Metric",
    "Roc",
    "Threshold",
    "TruthError",
    "block_flow",
    "block_share",
    "bound_photons",
    "combine",
    "confined_velocities",
    "cramer_rao_covariance",
    "cramer_rao_covariance_along_x",
    "d_prime",
    "error_curve",
    "error_sums",
    "false_alarm_rate",
    "fisher_information",
    "format_flux",
    "is_within",
    "motion_evidence",
    "photons_for_half",
    "rightward_evidence",
    "roc",
    "truth_error",
    "truth_splits",
    "variance_efficiency",
]
