"""Real cameras: link to SPADCAM, recordings, calibration, comparison with simulation."""
