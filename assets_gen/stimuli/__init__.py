"""Gratings, dead leaves and bodies."""
