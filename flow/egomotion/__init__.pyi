from .heading import CameraMotion, camera_motion
from .wide_field import WideField, fit_wide_field
from .yaw_rate import YawRateTest, yaw_rates_deg_s

__all__ = [
    "CameraMotion",
    "WideField",
    "YawRateTest",
    "camera_motion",
    "fit_wide_field",
    "yaw_rates_deg_s",
]
