"""The likelihood of counts, and the flow that maximizes it."""
