"""What stands where, what lights it and how the camera moves, as plain frozen data.

    light, camera, trajectory = Light(level="starlight"), PerspectiveCamera(), Trajectory()
    scene = build_scene(Forest(trees=200), light, camera, trajectory)

World coordinates are right-handed meters with z up. Nothing here knows a renderer.
"""

from megalopta.scenes.bench import Bench
from megalopta.scenes.build import build_scene
from megalopta.scenes.camera import Camera, PerspectiveCamera
from megalopta.scenes.forest import Forest
from megalopta.scenes.grating import Grating
from megalopta.scenes.light import Light
from megalopta.scenes.objects import MovingObject
from megalopta.scenes.panorama import Panorama
from megalopta.scenes.panoramic_camera import CylindricalCamera, EquirectangularCamera
from megalopta.scenes.plane import Plane
from megalopta.scenes.scene import Scene
from megalopta.scenes.shutter import Shutter
from megalopta.scenes.sway import Wind
from megalopta.scenes.trajectory import CameraPath, Trajectory
from megalopta.scenes.trajectory_hover import Hover
from megalopta.scenes.trajectory_orbit import Orbit
from megalopta.scenes.trajectory_recorded import Recorded
from megalopta.scenes.trajectory_spline import Spline

__all__ = [
    "Bench",
    "Camera",
    "CameraPath",
    "CylindricalCamera",
    "EquirectangularCamera",
    "Forest",
    "Grating",
    "Hover",
    "Light",
    "MovingObject",
    "Orbit",
    "Panorama",
    "PerspectiveCamera",
    "Plane",
    "Recorded",
    "Scene",
    "Shutter",
    "Spline",
    "Trajectory",
    "Wind",
    "build_scene",
]
