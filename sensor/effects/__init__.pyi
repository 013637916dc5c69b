from . import (
    afterpulsing as afterpulsing,
    crosstalk as crosstalk,
    dead_time as dead_time,
    gated_paralyzable as gated_paralyzable,
    paralyzable as paralyzable,
)
from .afterpulsing import (
    Afterpulsing as Afterpulsing,
    draw_carriers as draw_carriers,
    draw_delay as draw_delay,
)
from .base import (
    Effect as Effect,
    PixelRates as PixelRates,
    Stage as Stage,
)
from .bias import (
    Bias as Bias,
    best_excess_bias as best_excess_bias,
    breakdown_offset as breakdown_offset,
)
from .crosstalk import (
    Crosstalk as Crosstalk,
    neighborhood as neighborhood,
)
from .dark_counts import (
    DarkCounts as DarkCounts,
    dark_count_rate as dark_count_rate,
    mean_density as mean_density,
)
from .dead_time import (
    MOST_ARRIVALS as MOST_ARRIVALS,
    DeadTime as DeadTime,
    check_arrivals as check_arrivals,
    expected_counts as expected_counts,
)
from .fields import (
    AvalancheEffects as AvalancheEffects,
    RateEffects as RateEffects,
)
from .gating import (
    Gate as Gate,
    is_open as is_open,
    open_fraction as open_fraction,
    open_time as open_time,
    part_weights as part_weights,
    wall_time as wall_time,
)
from .jitter import (
    Jitter as Jitter,
    stamp as stamp,
)
from .mismatch import AvalancheMaps as AvalancheMaps
from .temperature import (
    Temperature as Temperature,
    dark_count_factor as dark_count_factor,
)
