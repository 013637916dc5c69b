from .description import Forest, build_forest
from .stand import PRESETS
from .sway import Sway

__all__ = [
    "PRESETS",
    "Forest",
    "Sway",
    "build_forest",
]
