from .noise import PlaneWaves, plane_waves, tileable_noise, to_weight
from .splats import strew

__all__ = [
    "PlaneWaves",
    "plane_waves",
    "strew",
    "tileable_noise",
    "to_weight",
]
