from .base import Path
from .choice import CameraPath
from .steady import Trajectory

__all__ = [
    "CameraPath",
    "Path",
    "Trajectory",
]
