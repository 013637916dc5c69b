"""Spectra, photometry and color."""
