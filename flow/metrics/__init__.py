"""Errors of responses: against itself, against the truth, against the physical limit."""
