"""Photon counts to motion: detectors, error metrics and the photon benchmark, on plain arrays."""
