"""Flow on disk and in color."""
