from .analog import AnalogCounter, AnalogPixels, analog_pixels, nominal_pixels
from .conversion import counts_of_codes, read_analog, sample_analog
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
    "counts_of_codes",
    "empty_counts",
    "events_until_full",
    "nominal_pixels",
    "read_analog",
    "read_digital",
    "sample_analog",
    "simple_moments",
]
