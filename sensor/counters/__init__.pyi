from .analog import AnalogCounter, AnalogPixels, analog_pixels
from .conversion import read_analog
from .digital import LARGEST_CAPACITY, Counts, DigitalCounter, empty_counts, read_digital
from .moments import counter_moments, events_until_full, simple_moments

__all__ = [
    "LARGEST_CAPACITY",
    "AnalogCounter",
    "AnalogPixels",
    "Counts",
    "DigitalCounter",
    "analog_pixels",
    "counter_moments",
    "empty_counts",
    "events_until_full",
    "read_analog",
    "read_digital",
    "simple_moments",
]
