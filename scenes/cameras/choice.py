"""The choice between all cameras."""

from typing import TYPE_CHECKING

from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.cameras.panoramic import CylindricalCamera, EquirectangularCamera
from megalopta.scenes.cameras.perspective import PerspectiveCamera
from megalopta.scenes.kinds import any_of

if TYPE_CHECKING:
    AnyCamera = Camera
else:
    AnyCamera = any_of((PerspectiveCamera, EquirectangularCamera, CylindricalCamera), "perspective")
    """Any camera in a configuration; `kind` tells which, and without it, it is perspective."""
