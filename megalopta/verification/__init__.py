"""Verification by users: truth, files."""
