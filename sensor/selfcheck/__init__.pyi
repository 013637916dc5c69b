from .brute_force import brute_force_counts as brute_force_counts
from .cases import CHECKS as CHECKS
from .comparison import (
    LARGEST_Z as LARGEST_Z,
    Row as Row,
    false_alarm as false_alarm,
    run_checks as run_checks,
    two_sample_z as two_sample_z,
)
