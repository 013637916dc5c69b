"""What dark, flat and stepped-exposure recordings tell of a device: one estimator a file."""
