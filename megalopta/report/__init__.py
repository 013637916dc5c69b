"""Pages about a dataset and about scenes, one HTML file each."""
