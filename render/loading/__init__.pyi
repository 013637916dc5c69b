from .meshes import MergedMesh, MovingMesh, merge
from .scene import (
    DISC_POINTS,
    bare_mesh,
    bitmap,
    gather,
    load_scene,
    move_meshes,
)
from .shapes import MeshIndex

__all__ = [
    "DISC_POINTS",
    "MergedMesh",
    "MeshIndex",
    "MovingMesh",
    "bare_mesh",
    "bitmap",
    "gather",
    "load_scene",
    "merge",
    "move_meshes",
]
