from .color_wheel import flow_to_rgb, wheel_legend
from .flo import read_flo, write_flo
from .flo5 import read_flo5, write_flo5
from .kitti_png import read_kitti_png, write_kitti_png

__all__ = [
    "flow_to_rgb",
    "read_flo",
    "read_flo5",
    "read_kitti_png",
    "wheel_legend",
    "write_flo",
    "write_flo5",
    "write_kitti_png",
]
