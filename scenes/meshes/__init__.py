"""Scenes and objects from mesh files."""
