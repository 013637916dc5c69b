"""Noise and splats that textures are made of."""
