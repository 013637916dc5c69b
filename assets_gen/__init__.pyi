from .scatter import generator as generator
from .surface import (
    FloatArray as FloatArray,
    Surface as Surface,
    cross as cross,
    grid_corners as grid_corners,
    grid_faces as grid_faces,
    join as join,
    lengths as lengths,
    unit as unit,
)
from .surface_textures import TEXTURES as TEXTURES
