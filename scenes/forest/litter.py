"""Fallen leaves that lie on an uneven floor, fewer on a trodden path and on moss."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from megalopta.assets_gen import Surface, generator
from megalopta.scenes.forest.floor import Floor
from megalopta.scenes.forest.specimens import grow_specimens
from megalopta.scenes.forest.undergrowth import LITTER, PLANTS
from megalopta.scenes.scene import Asset, Placement

FLATTENED, LEAST_M = 0.65, 0.001
"""Leaves rise above the ground by so much of what they do where they were strewn, but no less."""


def laid(
    seed: int, placements: Sequence[Placement], floor: Floor
) -> tuple[tuple[Placement, ...], dict[str, Asset]]:
    """Return all placements, each of litter with an asset of its own, and these assets.

    Every corner of a leaf lies over the ground's mesh as high as over level ground, but flatter.
    """
    lying = {each.asset for each in placements if each.kind == LITTER}
    specimens = grow_specimens(seed, lying)
    found: list[Placement] = []
    assets: dict[str, Asset] = {}
    rng = generator(seed, "litter that stays")
    for index, placement in enumerate(placements):
        if placement.kind != LITTER:
            found.append(placement)
            continue
        leaves = _draped(specimens[placement.asset]["leaf"], placement, floor, rng)
        if len(leaves.faces):
            name = f"{placement.asset} {index}"
            assets[name] = Asset({PLANTS[LITTER].part("leaf"): leaves.to_mesh()})
            found.append(replace(placement, asset=name))
    return tuple(found), assets


def _draped(
    leaves: Surface, placement: Placement, floor: Floor, rng: np.random.Generator
) -> Surface:
    linear, foot = placement.to_world[:3, :3], placement.to_world[:3, 3]
    places = leaves.vertices @ linear.T + foot
    corners = 4 if len(leaves.vertices) == 2 * len(leaves.faces) else 3
    count = len(places) // corners
    middles = places.reshape(count, corners, 3).mean(axis=1)
    kept = rng.random(count) < floor.litter(middles[:, :2])
    above = FLATTENED * np.cbrt(np.linalg.det(linear)) * leaves.vertices[:, 2]
    places[:, 2] = floor.height(places[:, :2]) + np.maximum(above, LEAST_M)
    local = (places - foot) @ np.linalg.inv(linear).T
    chosen = np.repeat(kept, corners)
    faces = leaves.faces.reshape(count, -1)[0]
    first = corners * np.arange(kept.sum())[:, None]
    return Surface(local[chosen], (first + faces).reshape(-1, 3), leaves.uv[chosen])
