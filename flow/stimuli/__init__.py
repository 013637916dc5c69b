"""What detectors are shown: moving templates, sizes, photons."""
