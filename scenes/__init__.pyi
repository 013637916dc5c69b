from .base import SceneDescription
from .build import AnyScene, build_scene
from .cameras.base import Camera
from .cameras.choice import AnyCamera
from .cameras.panoramic import CylindricalCamera, EquirectangularCamera
from .cameras.perspective import PerspectiveCamera
from .forest.description import Forest
from .forest.sway import Wind
from .lighting.levels import Light
from .moving_objects import MovingObject
from .shutter import Shutter
from .stimuli.grating import Grating
from .stimuli.motion_bench import MotionBench
from .stimuli.panorama import Panorama
from .stimuli.plane import Plane
from .tone_mapping import ToneCurve, preview, white_of
from .trajectories.choice import CameraPath
from .trajectories.hover import Hover
from .trajectories.orbit import Orbit
from .trajectories.recorded import Recorded
from .trajectories.spline import Spline
from .trajectories.steady import Trajectory
from .world.scene import Scene

__all__ = [
    "AnyCamera",
    "AnyScene",
    "Camera",
    "CameraPath",
    "CylindricalCamera",
    "EquirectangularCamera",
    "Forest",
    "Grating",
    "Hover",
    "Light",
    "MotionBench",
    "MovingObject",
    "Orbit",
    "Panorama",
    "PerspectiveCamera",
    "Plane",
    "Recorded",
    "Scene",
    "SceneDescription",
    "Shutter",
    "Spline",
    "ToneCurve",
    "Trajectory",
    "Wind",
    "build_scene",
    "preview",
    "white_of",
]
