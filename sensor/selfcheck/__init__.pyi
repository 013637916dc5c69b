from .all import EFFECT_CHECKS
from .comparison import LARGEST_Z, Row, false_alarm, run_checks
from .counting import AFTERPULSING, Kind, counting_checks, effects_of, operating_point, samples

__all__ = [
    "AFTERPULSING",
    "EFFECT_CHECKS",
    "LARGEST_Z",
    "Kind",
    "Row",
    "counting_checks",
    "effects_of",
    "false_alarm",
    "operating_point",
    "run_checks",
    "samples",
]
