from .moss import (
    Moss as Moss,
    cut_at as cut_at,
    make_moss as make_moss,
)
from .octaves import (
    Octaves as Octaves,
    make_octaves as make_octaves,
)
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
from .trail import (
    Trail as Trail,
    make_trail as make_trail,
)
from .triangulation import (
    Fineness as Fineness,
    Triangulation as Triangulation,
    triangulated as triangulated,
)
