from . import afterpulsing, crosstalk, dead_time, gated_paralyzable
from .afterpulsing import Afterpulsing, draw_carriers, draw_delay
from .base import Effect, PixelRates, Stage
from .bias import Bias, best_excess_bias, breakdown_offset
from .crosstalk import Crosstalk, neighborhood
from .dark_counts import DarkCounts, dark_count_rate, mean_density
from .dead_time import MOST_ARRIVALS, DeadTime, check_arrivals, expected_counts
from .fields import AvalancheEffects, RateEffects
from .gating import Gate, is_open, open_fraction, open_time, wall_time
from .jitter import Jitter, stamp
from .mismatch import AvalancheMaps
from .temperature import Temperature, dark_count_factor

__all__ = [
    "MOST_ARRIVALS",
    "Afterpulsing",
    "AvalancheEffects",
    "AvalancheMaps",
    "Bias",
    "Crosstalk",
    "DarkCounts",
    "DeadTime",
    "Effect",
    "Gate",
    "Jitter",
    "PixelRates",
    "RateEffects",
    "Stage",
    "Temperature",
    "afterpulsing",
    "best_excess_bias",
    "breakdown_offset",
    "check_arrivals",
    "crosstalk",
    "dark_count_factor",
    "dark_count_rate",
    "dead_time",
    "draw_carriers",
    "draw_delay",
    "expected_counts",
    "gated_paralyzable",
    "is_open",
    "mean_density",
    "neighborhood",
    "open_fraction",
    "open_time",
    "stamp",
    "wall_time",
]
