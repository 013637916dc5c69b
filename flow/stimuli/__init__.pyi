from .moving_template import MovingTemplate, blurred, summed
from .photons import (
    BlackFrameError,
    Counts,
    Normalization,
    divisors,
    draw_counts,
    frame_light,
    narrowest,
)
from .resizing import ResizeKind, resize, resized_shape
from .statistics import ImageStatistics, image_statistics, power_spectrum

__all__ = [
    "BlackFrameError",
    "Counts",
    "ImageStatistics",
    "MovingTemplate",
    "Normalization",
    "ResizeKind",
    "blurred",
    "divisors",
    "draw_counts",
    "frame_light",
    "image_statistics",
    "narrowest",
    "power_spectrum",
    "resize",
    "resized_shape",
    "summed",
]
