"""Camera projections."""
