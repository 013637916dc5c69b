"""The land that a forest stands on, and its ground where it is an even cover."""

from scipy.spatial import cKDTree

from megalopta.assets_gen import generator
from megalopta.assets_gen.terrain import Terrain, ground_surface, make_terrain
from megalopta.scenes.scene import Asset

RIM_WIDTH_M, RIM_HEIGHT_M = 22.0, 7.0
"""Behind the stand the land rises over this width by this height (m)."""
HORIZON_M = 160.0
"""The ground reaches this far beyond the stand (m)."""
GROUND_STEP_M, GROUND_NEAR_M = 0.4, 10.0
"""Grid of the ground's mesh up to a distance from the path (m)."""


def make_land(seed: int, path: cKDTree, relief_m: float, edge_m: float) -> Terrain:
    """Return the land around a path whose stand reaches up to a distance (m)."""
    rim_m = (edge_m, edge_m + RIM_WIDTH_M)
    return make_terrain(path, relief_m, rim_m, RIM_HEIGHT_M, generator(seed, "terrain"))


def even_ground(cover: str, land: Terrain, edge_m: float) -> Asset:
    """Return smooth ground of one cover."""
    low, high = land.path.mins - GROUND_NEAR_M, land.path.maxes + GROUND_NEAR_M
    surface = ground_surface(land, low, high, GROUND_STEP_M, edge_m + HORIZON_M)
    return Asset({f"{cover} ground": surface.to_mesh()})
