from .analog import AnalogCounter, AnalogPixels, analog_pixels, error_variance, read_analog
from .digital import LARGEST_CAPACITY, Counts, DigitalCounter, empty_counts, read_digital

__all__ = [
    "LARGEST_CAPACITY",
    "AnalogCounter",
    "AnalogPixels",
    "Counts",
    "DigitalCounter",
    "analog_pixels",
    "empty_counts",
    "error_variance",
    "read_analog",
    "read_digital",
]
