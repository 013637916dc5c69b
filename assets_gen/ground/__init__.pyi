from .rocks import (
    STONE_TILE_M as STONE_TILE_M,
    grow_rock as grow_rock,
)
from .scatter import (
    distance_to as distance_to,
    poisson_disk as poisson_disk,
)
from .terrain import (
    GROUND_TILE_M as GROUND_TILE_M,
    Terrain as Terrain,
    ground_surface as ground_surface,
    make_terrain as make_terrain,
)
