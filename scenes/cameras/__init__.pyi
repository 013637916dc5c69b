from .panoramic import CylindricalCamera
from .perspective import Camera, PerspectiveCamera

__all__ = [
    "Camera",
    "CylindricalCamera",
    "PerspectiveCamera",
]
