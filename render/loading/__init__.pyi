from .air import (
    Air as Air,
    fill as fill,
)
from .materials import bitmap as bitmap
from .meshes import (
    MergedMesh as MergedMesh,
    MovingMesh as MovingMesh,
    merge as merge,
)
from .scene import (
    DISC_POINTS as DISC_POINTS,
    bare_mesh as bare_mesh,
    gather as gather,
    load_again as load_again,
    load_scene as load_scene,
    move_meshes as move_meshes,
    part_of_scene as part_of_scene,
)
from .shapes import MeshIndex as MeshIndex
from .sky import SkyPatterns as SkyPatterns
