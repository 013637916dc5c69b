"""A whole tree or bush: bark around its axes, leaves on its twigs."""

from dataclasses import dataclass

import numpy as np

from megalopta.assets_gen import FloatArray, Surface, join
from megalopta.assets_gen.plants.bark import TILE_M
from megalopta.assets_gen.plants.branching import Branching, grow_axes
from megalopta.assets_gen.plants.foliage import place_leaves
from megalopta.assets_gen.plants.skeleton import IndexArray, Skeleton, axes, pipe_radii
from megalopta.assets_gen.plants.species import Species
from megalopta.assets_gen.plants.tube import sweep

BREAST_HEIGHT_M = 1.3
STEM_FINENESS = 0.3
"""Stems are drawn this much closer to their shape than branches."""


@dataclass(frozen=True)
class Plant:
    """One grown plant, its foot at the origin."""

    species: Species
    branching: Branching
    radii_m: FloatArray
    """(n,): radius at every node of the skeleton."""
    tubes: tuple[Surface, ...]
    """One closed tube per axis."""
    leaves: Surface

    @property
    def wood(self) -> Surface:
        """All tubes as one surface."""
        return join(self.tubes)


def grow_plant(species: Species, rng: np.random.Generator) -> Plant:
    """Return one individual of a species."""
    branching = grow_axes(species, rng)
    skeleton = branching.skeleton
    reference = min(BREAST_HEIGHT_M, species.height_m / 3)
    radii = pipe_radii(skeleton, species.disused_share, species.radius_m, reference)
    tubes = [
        bark_around(species, skeleton, radii, nodes, species.chord_m, rng)
        for nodes in axes(skeleton, radii)
    ]
    leaves = place_leaves(skeleton.positions[branching.bearing], species.foliage, rng)
    return Plant(species, branching, radii, tuple(tubes), leaves)


def bark_around(
    species: Species,
    skeleton: Skeleton,
    radii_m: FloatArray,
    nodes: IndexArray,
    chord_m: float,
    rng: np.random.Generator,
) -> Surface:
    """Return the tube around one axis, with no more rings and sides than `chord_m` asks for.

    However few its sides, it is as wide on average as the round branch that it stands for.
    """
    is_stem = skeleton.parents[nodes[0]] < 0
    positions, radius = skeleton.positions[nodes], radii_m[nodes]
    if not is_stem:
        radius[0] = radius[1]  # the first node lies inside the bearing axis and has its radius
    sides = _sides(radius[0], chord_m)
    profile = np.repeat(radius[:, None] * _as_wide_as_a_circle(sides), sides, axis=1)
    if is_stem:
        profile *= root_flare(positions[:, 2], sides, radius[0], species.flare, rng)
    outline = np.column_stack([positions, profile.max(axis=1)])
    kept = simplified(outline, chord_m * (STEM_FINENESS if is_stem else 1))
    origin = rng.random(2)
    return sweep(positions[kept], profile[kept][:-1], TILE_M, origin, whole_tiles=is_stem)


def _sides(radius_m: float, chord_m: float) -> int:
    """Return how many sides make a tube look round at the detail that `chord_m` asks for."""
    return int(np.interp(radius_m / chord_m, [0.3, 0.6, 1, 2], [3, 4, 6, 12]))


def _as_wide_as_a_circle(sides: int) -> float:
    """Return the circumradius of the regular polygon with the unit circle's circumference.

    By Cauchy's formula convex outlines of one circumference are equally wide on average.
    """
    return float(np.pi / (sides * np.sin(np.pi / sides)))


def root_flare(
    z: FloatArray, sides: int, radius_m: float, flare: float, rng: np.random.Generator
) -> FloatArray:
    """Return the factor (k, sides) by which the stem widens into roots near the ground."""
    angle = 2 * np.pi * np.arange(sides) / sides
    lobes = 0.65 + 0.35 * np.cos(3 * angle + rng.uniform(0, 2 * np.pi))
    decay = np.exp(-np.maximum(z, 0) / (2.2 * radius_m))
    return 1 + flare * decay[:, None] * lobes


def simplified(points: FloatArray, tolerance: float) -> IndexArray:
    """Return which points of a polyline (k, d) keep it within `tolerance` (Douglas–Peucker)."""
    keep = {0, len(points) - 1}
    spans = [(0, len(points) - 1)]
    while spans:
        low, high = spans.pop()
        if high - low < 2:
            continue
        chord = points[high] - points[low]
        inner = points[low + 1 : high] - points[low]
        share = np.clip(inner @ chord / max(chord @ chord, 1e-12), 0, 1)
        error = np.linalg.norm(inner - share[:, None] * chord, axis=1)
        worst = int(error.argmax())
        if error[worst] > tolerance:
            keep.add(low + 1 + worst)
            spans += [(low, low + 1 + worst), (low + 1 + worst, high)]
    return np.array(sorted(keep))
