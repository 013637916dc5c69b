"""A look at the whole sequence before anything is baked: how much of it each cell fills."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from megalopta.render import dr, mi
from megalopta.render.baking.cells import CellFinder, pixel_angle
from megalopta.scenes.cameras import Camera

VIEWS = 512
"""Rays per pixel over the whole sequence, however long. One in twenty of a frame meets what these
did not."""


def views(
    camera: Camera, poses: NDArray[np.float64], count: int, seed: int, step: int = 1
) -> Iterator[Any]:
    """A ray for every `step`-th pixel from each of `count` poses spread over those (T, 4, 4).

    For each view the camera is turned by up to half a pixel at random, so that rays meet what lies
    between pixel centers.
    """
    axes = camera.directions().reshape(-1, 3)[::step]
    turns = np.random.default_rng(seed).uniform(-0.5, 0.5, (count, 3)) * pixel_angle(camera)
    frames = np.linspace(0, len(poses) - 1, count).round().astype(int)
    for pose, turn in zip(poses[frames], turns, strict=True):
        directions = Rotation.from_rotvec(turn).apply(axes) @ pose[:3, :3].T
        origin = mi.Point3f(pose[:3, 3].tolist())
        dr.make_opaque(origin)  # or every view would be compiled anew
        yield mi.Ray3f(origin, mi.Vector3f(np.ascontiguousarray(directions.T)))


def survey(
    loaded: Any,
    finder: CellFinder,
    cells: int,
    camera: Camera,
    poses: NDArray[np.float64],
    seed: int,
    count: int = VIEWS,
    step: int = 1,
) -> NDArray[np.uint32]:
    """How often (cells,) each cell is seen by rays, `count` a pixel over all poses (T, 4, 4).

    Of every `step`-th pixel.
    """
    seen = dr.zeros(mi.UInt, cells)
    for rays in views(camera, poses, count, seed, step):
        sight = finder.look(loaded, rays)
        dr.scatter_add(seen, mi.UInt(1), sight.cell, sight.shaded)
        dr.eval(seen)
    return np.array(seen)
