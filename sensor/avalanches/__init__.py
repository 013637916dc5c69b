"""Interaction of effects in time: simulated avalanches, drawn counts and their moments."""
