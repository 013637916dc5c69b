"""Optics: from radiance to photons on a pixel, and how many of them are detected."""
