from .heading import (
    CameraMotion as CameraMotion,
    motion_of_flow as motion_of_flow,
)
from .likely_motion import likely_camera_motion as likely_camera_motion
from .wide_field import fit_wide_field as fit_wide_field
from .yaw_rate import (
    YawRateTest as YawRateTest,
    yaw_rates_deg_s as yaw_rates_deg_s,
)
