from .drawing import (
    check_plan,
    configuration_of,
    repeated,
    repeated_name,
    sequence_name,
    split_of,
)
from .model import FlowFile, Plan, load_plan

__all__ = [
    "FlowFile",
    "Plan",
    "check_plan",
    "configuration_of",
    "load_plan",
    "repeated",
    "repeated_name",
    "sequence_name",
    "split_of",
]
