"""How many photons a measurement needs."""
