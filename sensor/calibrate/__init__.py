"""Estimates of a device from dark, flat and stepped-exposure recordings; corrected frames."""
