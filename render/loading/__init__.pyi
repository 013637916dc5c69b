from .environment import PanoramaView, read_picture
from .meshes import MergedMesh, MovingMesh, merge
from .scene import (
    DISC_POINTS,
    aim,
    bare_mesh,
    bitmap,
    gather,
    load_rows_sensor,
    load_scene,
    load_sensor,
    move_meshes,
    sensor_transform_matrix,
)

__all__ = [
    "DISC_POINTS",
    "MergedMesh",
    "MovingMesh",
    "PanoramaView",
    "aim",
    "bare_mesh",
    "bitmap",
    "gather",
    "load_rows_sensor",
    "load_scene",
    "load_sensor",
    "merge",
    "move_meshes",
    "read_picture",
    "sensor_transform_matrix",
]
