"""Stimuli of detectors: moving templates, sizes, photons."""
