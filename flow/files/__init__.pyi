from .color_wheel import flow_to_rgb, wheel_legend
from .flo import write_flo

__all__ = [
    "flow_to_rgb",
    "wheel_legend",
    "write_flo",
]
