"""Proofs for users: physics, truth, files."""

GROUPS = (
    *("counting", "light", "device", "dead-time", "afterpulsing", "crosstalk", "combinations"),
    *("gate", "changing-light", "counters", "frames", "ctia"),
)
"""Of what `megalopta check physics` compares"""
