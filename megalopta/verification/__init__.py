"""Verification by users: physics, truth, files."""

GROUPS = (
    *("counting", "light", "device", "dead-time", "afterpulsing", "crosstalk", "combinations"),
    *("gate", "changing-light", "counters", "frames", "ctia"),
)
"""Groups of cases of `megalopta check physics`"""
