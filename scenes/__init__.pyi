from .base import SceneDescription as SceneDescription
from .build import (
    AnyCamera as AnyCamera,
    AnyScene as AnyScene,
    CameraPath as CameraPath,
    build_scene as build_scene,
)
from .cameras.base import Camera as Camera
from .cameras.opencv import OpenCVCamera as OpenCVCamera
from .cameras.panoramic import (
    CylindricalCamera as CylindricalCamera,
    EquirectangularCamera as EquirectangularCamera,
)
from .cameras.perspective import PerspectiveCamera as PerspectiveCamera
from .forest.description import Forest as Forest
from .forest.sway import Wind as Wind
from .imu import Imu as Imu
from .levels import LEVELS as LEVELS
from .light import Light as Light
from .meshes.description import Meshes as Meshes
from .moving_objects import (
    AnyObject as AnyObject,
    MovingModel as MovingModel,
    MovingObject as MovingObject,
)
from .scene import Haze as Haze, Scene as Scene
from .shutter import Shutter as Shutter
from .stimuli.grating import Grating as Grating
from .stimuli.panorama import Panorama as Panorama
from .stimuli.pictures import Pictures as Pictures
from .stimuli.plane import MotionBench as MotionBench, Plane as Plane
from .tone_mapping import ToneCurve as ToneCurve, preview as preview
from .trajectories.base import Mount as Mount
from .trajectories.orbit import Orbit as Orbit
from .trajectories.recorded import Recorded as Recorded
from .trajectories.steady import Hover as Hover, Trajectory as Trajectory
