from .recorded import reproduce_captured

__all__ = ["reproduce_captured"]
