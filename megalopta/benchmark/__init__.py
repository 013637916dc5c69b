"""Benchmarks of motion detectors: rankings, scores, boards, photon thresholds."""
