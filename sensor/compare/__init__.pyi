from .counted import CountedFrames
from .equivalence import Difference, difference
from .order import Arrangement, arrangement, matching_rows
from .quantities import BLOCKS, block_quantities
from .recordings import FALSE_ALARMS, MARGIN, UNITS, Comparison, compare_recordings
from .spectrum import BANDS, SEGMENT, band_powers, mean_spectrum
from .two_sample import (
    HistogramTest,
    PixelTest,
    discoveries,
    histogram_test,
    mean_test,
    variance_test,
)

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
    "HistogramTest",
    "PixelTest",
    "arrangement",
    "band_powers",
    "block_quantities",
    "compare_recordings",
    "difference",
    "discoveries",
    "histogram_test",
    "matching_rows",
    "mean_spectrum",
    "mean_test",
    "variance_test",
]
