from .analog import (
    AnalogCounter as AnalogCounter,
    AnalogPixels as AnalogPixels,
    analog_pixels as analog_pixels,
    nominal_pixels as nominal_pixels,
)
from .conversion import (
    counts_of_codes as counts_of_codes,
    read_analog as read_analog,
    sample_analog as sample_analog,
)
from .digital import (
    LARGEST_CAPACITY as LARGEST_CAPACITY,
    Counts as Counts,
    DigitalCounter as DigitalCounter,
    empty_counts as empty_counts,
    read_digital as read_digital,
)
from .moments import (
    counter_moments as counter_moments,
    events_until_full as events_until_full,
    misreads as misreads,
    simple_moments as simple_moments,
)
from .tabulated import (
    LawTable as LawTable,
    tabulated_moments as tabulated_moments,
)
