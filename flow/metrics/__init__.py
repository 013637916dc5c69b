"""How good a response is: against itself, against the truth, against the physical limit."""
