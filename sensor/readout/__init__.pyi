from . import chance as chance
from .binary import (
    check_binary as check_binary,
    expose_binary as expose_binary,
    unpack as unpack,
)
from .events import (
    Events as Events,
    expose_events as expose_events,
    histogram as histogram,
)
from .growing import (
    ExtraArray as ExtraArray,
    GrowingCounts as GrowingCounts,
)
from .images import (
    ImageSensor as ImageSensor,
    expose_image as expose_image,
)
from .store import (
    Origin as Origin,
    counts_writer as counts_writer,
    format_attribute as format_attribute,
)
from .sub_frames import (
    NextFrames as NextFrames,
    light_between as light_between,
    sub_frames as sub_frames,
)
