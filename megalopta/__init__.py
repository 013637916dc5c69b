"""Scenes with exactly known motion, photon counts, and how well motion can be read from them."""

__version__ = "0.1.0"
