from .grating import Grating, sky_radiance
from .motion_bench import Bench
from .panorama import LUMINANCE_SHARES, Panorama
from .plane import Plane

__all__ = [
    "LUMINANCE_SHARES",
    "Bench",
    "Grating",
    "Panorama",
    "Plane",
    "sky_radiance",
]
