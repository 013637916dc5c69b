"""Real cameras: a link to SPADCAM, recordings, calibration, comparison with simulation."""
