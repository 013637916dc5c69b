"""Figures and tables of the dissertation, drawn again; comparisons beyond it."""
