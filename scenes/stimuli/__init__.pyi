from .grating import (
    Grating as Grating,
    sky_radiance as sky_radiance,
)
from .motion_bench import MotionBench as MotionBench
from .panorama import Panorama as Panorama
from .plane import Plane as Plane
