from .binary import check_binary, expose_binary, unpack
from .events import Events, expose_events, histogram
from .growing import ExtraArray, GrowingCounts
from .images import ImageSensor, expose_image
from .store import Origin, counts_writer
from .sub_frames import NextFrames, light_between, sub_frames

__all__ = [
    "Events",
    "ExtraArray",
    "GrowingCounts",
    "ImageSensor",
    "NextFrames",
    "Origin",
    "check_binary",
    "counts_writer",
    "expose_binary",
    "expose_events",
    "expose_image",
    "histogram",
    "light_between",
    "sub_frames",
    "unpack",
]
