from .curve import (
    ErrorCurve as ErrorCurve,
    error_curve as error_curve,
)
from .dense_error import (
    GROUPS as GROUPS,
    DenseError as DenseError,
    DenseErrors as DenseErrors,
)
from .detection import (
    Roc as Roc,
    d_prime as d_prime,
    false_alarm_rate as false_alarm_rate,
    motion_evidence as motion_evidence,
    rightward_evidence as rightward_evidence,
    roc as roc,
)
from .efficiency import (
    bound_photons as bound_photons,
    confined_velocities as confined_velocities,
    is_within as is_within,
    photons_for_half as photons_for_half,
    variance_efficiency as variance_efficiency,
)
from .endpoint_error import (
    FAST_PX as FAST_PX,
    OCCLUDED_SHARE as OCCLUDED_SHARE,
    SLOW_PX as SLOW_PX,
    block_flow as block_flow,
    block_share as block_share,
    truth_error as truth_error,
    truth_splits as truth_splits,
)
from .photon_threshold import (
    Threshold as Threshold,
    format_flux as format_flux,
)
from .response_error import (
    METRICS as METRICS,
    ErrorSums as ErrorSums,
    Metric as Metric,
    combine as combine,
    error_sums as error_sums,
    sums_of_errors as sums_of_errors,
)
from .translation_bound import (
    cramer_rao_covariance as cramer_rao_covariance,
    cramer_rao_covariance_along_x as cramer_rao_covariance_along_x,
    fisher_information as fisher_information,
    texture_spectrum as texture_spectrum,
    unknown_texture_photons as unknown_texture_photons,
)
