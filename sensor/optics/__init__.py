"""Optics: from radiance to photons on a pixel and the fraction detected."""
