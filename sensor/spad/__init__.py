"""SPAD arrays: parameters, presets, fixed pattern, avalanches, counters, moments of readings."""
