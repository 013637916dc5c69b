"""Forests: what grows where."""
