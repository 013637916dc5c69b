from .base import Camera as Camera
from .choice import AnyCamera as AnyCamera
from .panoramic import (
    CylindricalCamera as CylindricalCamera,
    EquirectangularCamera as EquirectangularCamera,
    PanoramicCamera as PanoramicCamera,
)
from .perspective import PerspectiveCamera as PerspectiveCamera
