"""Datasets on disk and in Python: folders, frames, records, lazy arrays."""
