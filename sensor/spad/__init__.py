"""The SPAD array as a whole: its parameters, presets, the pattern of its pixels, an exposure."""
