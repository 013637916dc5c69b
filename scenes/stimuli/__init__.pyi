from .grating import Grating, build_grating, sky_radiance
from .motion_bench import Bench, build_bench
from .panorama import LUMINANCE_SHARES, Panorama, build_panorama
from .plane import Plane, build_plane

__all__ = [
    "LUMINANCE_SHARES",
    "Bench",
    "Grating",
    "Panorama",
    "Plane",
    "build_bench",
    "build_grating",
    "build_panorama",
    "build_plane",
    "sky_radiance",
]
