from .chain import calibrate_device as calibrate_device
from .comb import comb_period as comb_period
from .comb_fit import (
    CombFit as CombFit,
    fit_comb as fit_comb,
)
from .curve import Curve as Curve
from .device import (
    Device as Device,
    Estimate as Estimate,
)
from .garwood import garwood_interval as garwood_interval
from .level import (
    Adc as Adc,
    Falls as Falls,
    Level as Level,
    falls_of as falls_of,
)
from .neighbors import (
    OFFSETS as OFFSETS,
    Kernel as Kernel,
    mean_kernel as mean_kernel,
    neighbor_kernel as neighbor_kernel,
)
from .photon_transfer import (
    PhotonTransfer as PhotonTransfer,
    photon_transfer as photon_transfer,
)
from .saturation import (
    DeadTimeKind as DeadTimeKind,
    MeanCounts as MeanCounts,
    SaturationFit as SaturationFit,
    dead_time_moments as dead_time_moments,
    fit_kind as fit_kind,
    fit_saturation as fit_saturation,
    is_kind_clear as is_kind_clear,
)
from .support import check_levels as check_levels
