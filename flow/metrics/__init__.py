"""Errors of responses: against themselves, the truth, and the physical limit."""
