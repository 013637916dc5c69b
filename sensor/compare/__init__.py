"""Comparison of two recordings of one stimulus: presence, size and cause of differences."""
