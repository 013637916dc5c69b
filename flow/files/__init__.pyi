from .color_wheel import flow_to_rgb, wheel_legend
from .flo import write_flo
from .reading import FLOW_SUFFIXES, read_flow

__all__ = [
    "FLOW_SUFFIXES",
    "flow_to_rgb",
    "read_flow",
    "wheel_legend",
    "write_flo",
]
