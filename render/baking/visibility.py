"""A look at the whole sequence before anything is baked: how much of it each cell fills."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from megalopta.render import dr, mi
from megalopta.render.baking.cells import CellFinder, pixel_angle
from megalopta.scenes.cameras import Camera

# Rays per pixel over the whole sequence, however long.
_VIEWS = 256


def survey(
    loaded: Any,
    finder: CellFinder,
    cells: int,
    camera: Camera,
    poses: NDArray[np.float64],
    seed: int,
) -> NDArray[np.uint32]:
    """How often (cells,) each cell is seen by 256 rays per pixel spread over poses (T, 4, 4).

    For each view the camera is turned by up to half a pixel at random, so that rays meet what lies
    between pixel centers.
    """
    seen = dr.zeros(mi.UInt, cells)
    axes = camera.directions().reshape(-1, 3)
    turns = np.random.default_rng(seed).uniform(-0.5, 0.5, (_VIEWS, 3)) * pixel_angle(camera)
    frames = np.linspace(0, len(poses) - 1, _VIEWS).round().astype(int)
    for pose, turn in zip(poses[frames], turns, strict=True):
        directions = Rotation.from_rotvec(turn).apply(axes) @ pose[:3, :3].T
        origin = mi.Point3f(pose[:3, 3].tolist())
        dr.make_opaque(origin)  # or every view would be compiled anew
        rays = mi.Ray3f(origin, mi.Vector3f(np.ascontiguousarray(directions.T)))
        sight = finder.look(loaded, rays)
        dr.scatter_add(seen, mi.UInt(1), sight.cell, sight.shaded)
        dr.eval(seen)
    return np.array(seen)
