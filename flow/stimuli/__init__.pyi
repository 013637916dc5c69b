from .moving_template import BlackFrameError, MovingTemplate, blurred, summed
from .photons import Counts, brightness, draw_counts, narrowest
from .resizing import ResizeKind, resize, resized_shape
from .statistics import ImageStatistics, image_statistics, power_spectrum

__all__ = [
    "BlackFrameError",
    "Counts",
    "ImageStatistics",
    "MovingTemplate",
    "ResizeKind",
    "blurred",
    "brightness",
    "draw_counts",
    "image_statistics",
    "narrowest",
    "power_spectrum",
    "resize",
    "resized_shape",
    "summed",
]
