"""Stages from scene to measurement, one per file."""
