"""SPAD arrays: parameters, presets, fixed pattern, counters and moments of readings."""
