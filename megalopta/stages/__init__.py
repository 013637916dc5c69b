"""The stages from scene to measurement, one a file."""
