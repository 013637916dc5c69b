"""Proofs for users: physics, truth, files."""
