from .base import Camera
from .choice import AnyCamera
from .panoramic import CylindricalCamera, EquirectangularCamera, PanoramicCamera
from .perspective import PerspectiveCamera

__all__ = [
    "AnyCamera",
    "Camera",
    "CylindricalCamera",
    "EquirectangularCamera",
    "PanoramicCamera",
    "PerspectiveCamera",
]
