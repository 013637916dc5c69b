"""What stands where, what lights it and how the camera moves, as plain frozen data."""
