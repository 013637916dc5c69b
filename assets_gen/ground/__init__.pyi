from .rocks import STONE_TILE_M, grow_rock
from .scatter import distance_to, poisson_disk
from .terrain import GROUND_TILE_M, Terrain, ground_surface, make_terrain

__all__ = [
    "GROUND_TILE_M",
    "STONE_TILE_M",
    "Terrain",
    "distance_to",
    "ground_surface",
    "grow_rock",
    "make_terrain",
    "poisson_disk",
]
