from .noise import (
    PlaneWaves as PlaneWaves,
    plane_waves as plane_waves,
    tileable_noise as tileable_noise,
    to_weight as to_weight,
)
from .splats import strew as strew
