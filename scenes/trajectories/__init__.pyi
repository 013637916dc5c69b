from .base import Path as Path
from .choice import CameraPath as CameraPath
from .steady import Trajectory as Trajectory
