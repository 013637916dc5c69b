from .all import CHECKS as CHECKS
from .comparison import (
    LARGEST_Z as LARGEST_Z,
    Row as Row,
    false_alarm as false_alarm,
    run_checks as run_checks,
)
from .counting import (
    AFTERPULSING as AFTERPULSING,
    Kind as Kind,
    effects_of as effects_of,
    operating_point as operating_point,
    samples as samples,
)
