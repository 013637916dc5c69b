from .base import Path, steady_unless_told
from .steady import CameraPath, Trajectory

__all__ = [
    "CameraPath",
    "Path",
    "Trajectory",
    "steady_unless_told",
]
