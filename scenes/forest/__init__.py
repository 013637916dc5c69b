"""Forests: plants, ground and their layout."""
