from .yaw_rate import rotation_error, yaw_rates_deg_s

__all__ = [
    "rotation_error",
    "yaw_rates_deg_s",
]
