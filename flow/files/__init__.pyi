from .color_wheel import (
    flow_to_rgb as flow_to_rgb,
    wheel_legend as wheel_legend,
)
from .flo import write_flo as write_flo
from .reading import (
    FLOW_SUFFIXES as FLOW_SUFFIXES,
    read_flow as read_flow,
)
