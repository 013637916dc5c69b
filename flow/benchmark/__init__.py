"""Photon benchmarks of detectors."""
