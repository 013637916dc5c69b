"""Light to single-photon counts: optics, detection, dark counts and dead time, on plain arrays."""
