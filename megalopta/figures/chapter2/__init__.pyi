from .recorded import reproduce_captured as reproduce_captured
