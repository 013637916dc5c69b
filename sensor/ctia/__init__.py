"""The adaptive CTIA pixel for short-wave infrared, and its array."""
