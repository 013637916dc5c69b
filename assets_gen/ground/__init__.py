"""Terrain, rocks, and where things are scattered."""
