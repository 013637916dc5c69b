from .color_wheel import (
    flow_to_rgb as flow_to_rgb,
    wheel_legend as wheel_legend,
)
from .flo import (
    read_flo as read_flo,
    write_flo as write_flo,
)
from .flo5 import (
    read_flo5 as read_flo5,
    write_flo5 as write_flo5,
)
from .kitti_png import (
    read_kitti_png as read_kitti_png,
    write_kitti_png as write_kitti_png,
)
from .reading import (
    FLOW_SUFFIXES as FLOW_SUFFIXES,
    read_flow as read_flow,
)
