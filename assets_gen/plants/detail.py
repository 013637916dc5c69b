"""Plants for distant views: the same individual with fewer, larger leaves and twigs.

Leaves and twigs are thinned at random and the rest enlarged to the same total area (Cook et al.
2007, "Stochastic simplification of aggregate detail", ACM TOG 26:3). Crowns keep their place,
outline, color, distribution of leaf angles and, nearly, their gap fraction.
"""

from dataclasses import dataclass

import numpy as np

from megalopta.assets_gen import FloatArray, Surface, cross, join, lengths
from megalopta.assets_gen.plants.growth import Plant, bark_around
from megalopta.assets_gen.plants.skeleton import IndexArray


@dataclass(frozen=True)
class Detail:
    """Coarseness of a drawn plant."""

    leaf_m2: float
    """Area up to which neighboring leaves are merged (m²)."""
    merged: int
    """Number of twigs merged into one."""
    thinnest_m: float
    """Radius at the base below which branches count as twigs (m)."""
    chord_m: float
    """Bend and taper below which branches are drawn straight (m)."""


def coarsened(plant: Plant, detail: Detail, rng: np.random.Generator) -> tuple[Surface, Surface]:
    """Return wood and leaves of a plant drawn coarsely.

    Stems and branches are straighter, with few thick twigs instead of many thin.
    """
    wood, skeleton, radii = plant.wood, plant.branching.skeleton, plant.radii_m
    if detail.thinnest_m > 0:
        base = np.array([radii[axis[1]] for axis in plant.axes])
        is_stem = np.array([skeleton.parents[axis[0]] < 0 for axis in plant.axes])
        thin = np.flatnonzero(~is_stem & (base < detail.thinnest_m))
        widening = np.where(np.isin(np.arange(len(base)), thin), 0.0, 1.0)
        if len(thin):
            chosen, factor = _one_of_each(plant.tube_areas[thin], detail.merged, rng)
            widening[thin[chosen]] = factor
        chord_m = max(detail.chord_m, plant.species.chord_m)
        coarse = plant.species.model_copy(update={"chord_m": chord_m})
        kept = np.flatnonzero(widening)
        along = [plant.axes[index] for index in kept]
        wood = join(bark_around(coarse, skeleton, radii, along, rng, widening[kept]))
    average_m2 = plant.leaves.area / (len(plant.leaves.faces) / 2)
    return wood, merged_leaves(plant.leaves, max(round(detail.leaf_m2 / average_m2), 1), rng)


def _one_of_each(
    area: FloatArray, merged: int, rng: np.random.Generator
) -> tuple[IndexArray, FloatArray]:
    """Return a random one of every `merged` neighbors, and their total area over its own."""
    starts = np.arange(0, len(area), merged)
    sizes = np.diff(np.append(starts, len(area)))
    chosen = starts + (rng.random(len(starts)) * sizes).astype(np.intp)
    return chosen, np.add.reduceat(area, starts) / area[chosen]


def merged_leaves(leaves: Surface, merged: int, rng: np.random.Generator) -> Surface:
    """Return one triangle for every `merged` neighbors among leaves of two triangles each.

    It is at the place of one of them, chosen at random, and has their total area.
    """
    corners = leaves.vertices.reshape(-1, 4, 3)
    area = np.add(*leaves.face_areas.reshape(-1, 2).T)
    chosen, factor = _one_of_each(area, merged, rng)
    base, left, tip, right = corners[chosen].swapaxes(0, 1)
    across = (right - left) / 2
    middle = corners[chosen].mean(axis=1)[:, None]
    triangle = np.stack([base + across, base - across, tip], axis=1)
    triangle += middle - triangle.mean(axis=1, keepdims=True)
    flat_area = lengths(cross(2 * across, tip - base)) / 2
    scale = np.sqrt(factor * area[chosen] / flat_area)[:, None, None]
    uv = leaves.uv.reshape(-1, 4, 2)[chosen]
    half = (uv[:, 3] - uv[:, 1]) * (1, 0) / 2
    return Surface(
        (middle + scale * (triangle - middle)).reshape(-1, 3),
        np.arange(3 * len(chosen)).reshape(-1, 3),
        np.stack([uv[:, 0] + half, uv[:, 0] - half, uv[:, 2]], axis=1).reshape(-1, 2),
        clusters=None if leaves.clusters is None else leaves.clusters[2 * chosen],
    )


def some_leaves(leaves: Surface, share: float, rng: np.random.Generator) -> Surface:
    """Return a random share of the leaves; smaller shares are subsets of larger ones."""
    count = len(leaves.vertices) // corners_of(leaves)
    return chosen_leaves(leaves, np.sort(rng.permutation(count)[: round(share * count)]))


def corners_of(leaves: Surface) -> int:
    """Return the number of corners per leaf: four with two triangles, three if merged."""
    return 4 if len(leaves.vertices) == 2 * len(leaves.faces) else 3


def chosen_leaves(leaves: Surface, chosen: IndexArray) -> Surface:
    """Return some leaves (k,)."""
    corners = corners_of(leaves)
    count = len(leaves.vertices) // corners
    faces = leaves.faces.reshape(count, -1)[0]
    first = corners * np.arange(len(chosen))[:, None]
    return Surface(
        leaves.vertices.reshape(count, -1)[chosen].reshape(-1, 3),
        (first + faces).reshape(-1, 3),
        leaves.uv.reshape(count, -1)[chosen].reshape(-1, 2),
        clusters=(
            None if leaves.clusters is None else leaves.clusters.reshape(count, -1)[chosen].ravel()
        ),
    )
