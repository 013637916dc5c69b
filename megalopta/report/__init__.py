"""Pages about a dataset and about scenes, each in one HTML file."""
