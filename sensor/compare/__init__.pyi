from .counted import CountedFrames
from .equivalence import Difference, difference
from .histograms import Distances, HistogramTest, distances_by_chance, histogram_test
from .order import Arrangement, arrangement, matching_rows
from .quantities import BLOCKS, block_quantities
from .recordings import FALSE_ALARMS, MARGIN, UNITS, Comparison, compare_recordings
from .scene import scene_differences
from .spectrum import BANDS, SEGMENT, band_powers, mean_spectrum
from .two_sample import PixelTest, discoveries, mean_test, variance_test

__all__ = [
    "BANDS",
    "BLOCKS",
    "FALSE_ALARMS",
    "MARGIN",
    "SEGMENT",
    "UNITS",
    "Arrangement",
    "Comparison",
    "CountedFrames",
    "Difference",
    "Distances",
    "HistogramTest",
    "PixelTest",
    "arrangement",
    "band_powers",
    "block_quantities",
    "compare_recordings",
    "difference",
    "discoveries",
    "distances_by_chance",
    "histogram_test",
    "matching_rows",
    "mean_spectrum",
    "mean_test",
    "scene_differences",
    "variance_test",
]
