from .meshes import MergedMesh, MovingMesh, merge
from .scene import (
    DISC_POINTS,
    bare_mesh,
    bitmap,
    gather,
    load_scene,
    move_meshes,
    part_of_scene,
)

__all__ = [
    "DISC_POINTS",
    "MergedMesh",
    "MovingMesh",
    "bare_mesh",
    "bitmap",
    "gather",
    "load_scene",
    "merge",
    "move_meshes",
    "part_of_scene",
]
