from .grating import Grating, sky_radiance
from .motion_bench import MotionBench
from .panorama import LUMINANCE_SHARES, Panorama
from .plane import Plane

__all__ = [
    "LUMINANCE_SHARES",
    "Grating",
    "MotionBench",
    "Panorama",
    "Plane",
    "sky_radiance",
]
