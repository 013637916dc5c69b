"""Proofs: every effect against theory and against simulations event by event."""
