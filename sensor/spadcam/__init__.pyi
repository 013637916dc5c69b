from .messages import (
    COLUMNS as COLUMNS,
    LARGEST_STEP_BIAS as LARGEST_STEP_BIAS,
    NOMINAL_STEP_BIAS as NOMINAL_STEP_BIAS,
    NOT_READ as NOT_READ,
    ROWS as ROWS,
    Identity as Identity,
    Settings as Settings,
    frame_packet as frame_packet,
    identify as identify,
    samples_of as samples_of,
    set_exposure as set_exposure,
    set_frame_rate as set_frame_rate,
    set_row_window as set_row_window,
    set_step_bias as set_step_bias,
)
from .packets import (
    LONGEST as LONGEST,
    PAYLOAD_BYTES as PAYLOAD_BYTES,
    Kind as Kind,
    Packet as Packet,
    Parser as Parser,
    encode as encode,
)
