from .chain import calibrate_device
from .comb import comb_period
from .comb_fit import CombFit, fit_comb
from .curve import Curve
from .device import Device, Estimate
from .garwood import garwood_interval
from .level import Adc, Falls, Level, falls_of
from .neighbors import OFFSETS, Kernel, mean_kernel, neighbor_kernel
from .photon_transfer import PhotonTransfer, photon_transfer
from .saturation import (
    DeadTimeKind,
    MeanCounts,
    SaturationFit,
    dead_time_moments,
    fit_kind,
    fit_saturation,
    is_kind_clear,
)
from .support import check_levels

__all__ = [
    "OFFSETS",
    "Adc",
    "CombFit",
    "Curve",
    "DeadTimeKind",
    "Device",
    "Estimate",
    "Falls",
    "Kernel",
    "Level",
    "MeanCounts",
    "PhotonTransfer",
    "SaturationFit",
    "calibrate_device",
    "check_levels",
    "comb_period",
    "dead_time_moments",
    "falls_of",
    "fit_comb",
    "fit_kind",
    "fit_saturation",
    "garwood_interval",
    "is_kind_clear",
    "mean_kernel",
    "neighbor_kernel",
    "photon_transfer",
]
