"""Extent of a scene, of which files may hold more than what a camera looks at."""

import numpy as np

from megalopta.assets_gen import cross, lengths
from megalopta.core.arrays import Floats
from megalopta.scenes.scene import Scene

_FAR = 20.0
"""Extent of a ground or a dome, over that of all that stands on it or in it."""


def bounds_of(scene: Scene) -> Floats:
    """Lowest and highest corner (2, 3), m, of the surfaces of a scene at time 0.

    Without vertices of no surface, without lamps if anything else is there, and without grounds and
    domes: surfaces around all others and 20 times as large.
    """
    boxes, lamps = [], []
    for placement in scene.placements:
        for material, mesh in scene.assets[placement.asset].parts.items():
            a, b, c = np.asarray(mesh.vertices)[np.asarray(mesh.faces).T]
            solid = np.asarray(mesh.faces)[lengths(cross(b - a, c - a)) > 0]
            points = mesh.vertices[np.unique(solid)] @ placement.to_world[:3, :3].T
            points = points + placement.to_world[:3, 3]
            if placement.motion:
                points = placement.motion.carry(points, 0.0)
            if len(points):
                boxes.append([points.min(axis=0), points.max(axis=0)])
                lamps.append(bool(scene.materials[material].emission))
    found, is_lamp = np.array(boxes).reshape(-1, 2, 3), np.array(lamps, bool)
    if not is_lamp.all():
        found = found[~is_lamp]
    found = found[np.argsort(lengths(found[:, 1] - found[:, 0]), kind="stable")]
    # Bounds of the first k, from the smallest on; and what all others cover together.
    low, high = np.minimum.accumulate(found[:, 0]), np.maximum.accumulate(found[:, 1])
    covered_low = np.maximum.accumulate(found[::-1, 0, :2])[::-1]
    covered_high = np.minimum.accumulate(found[::-1, 1, :2])[::-1]
    is_around = (covered_low[1:] <= low[:-1, :2]).all(1) & (covered_high[1:] >= high[:-1, :2]).all(
        1
    )
    sizes = lengths(found[:, 1] - found[:, 0])
    is_around &= sizes[1:] > _FAR * lengths(high - low)[:-1]
    last = int(np.flatnonzero(is_around)[-1]) if is_around.any() else -1
    return np.stack([low[last], high[last]])
