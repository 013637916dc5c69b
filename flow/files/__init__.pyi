from .color_wheel import (
    flow_to_rgb as flow_to_rgb,
    wheel_legend as wheel_legend,
)
from .flo import (
    read_flo as read_flo,
    write_flo as write_flo,
)
from .formats import (
    FLOW_SUFFIXES as FLOW_SUFFIXES,
    read_flo5 as read_flo5,
    read_flow as read_flow,
    read_kitti_png as read_kitti_png,
    write_flo5 as write_flo5,
    write_kitti_png as write_kitti_png,
)
