"""Figures and tables of the dissertation, reproduced, and comparisons beyond it."""
