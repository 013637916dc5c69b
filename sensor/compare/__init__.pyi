from .counted import CountedFrames as CountedFrames
from .equivalence import (
    Difference as Difference,
    difference as difference,
)
from .histograms import (
    Distances as Distances,
    HistogramTest as HistogramTest,
    distances_by_chance as distances_by_chance,
    histogram_test as histogram_test,
)
from .order import (
    Arrangement as Arrangement,
    arrangement as arrangement,
    matching_rows as matching_rows,
)
from .quantities import (
    BLOCKS as BLOCKS,
    block_quantities as block_quantities,
)
from .recordings import (
    FALSE_ALARMS as FALSE_ALARMS,
    MARGIN as MARGIN,
    UNITS as UNITS,
    Comparison as Comparison,
    compare_recordings as compare_recordings,
)
from .scene import scene_differences as scene_differences
from .spectrum import (
    BANDS as BANDS,
    SEGMENT as SEGMENT,
    band_powers as band_powers,
    mean_spectrum as mean_spectrum,
)
from .two_sample import (
    PixelTest as PixelTest,
    discoveries as discoveries,
    mean_test as mean_test,
    variance_test as variance_test,
)
