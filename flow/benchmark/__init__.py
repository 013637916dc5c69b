"""The photons that a measurement needs."""
