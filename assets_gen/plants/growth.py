"""Whole tree or bush: bark around its axes, leaves on its twigs."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from megalopta.assets_gen import FloatArray, Surface, join, lengths
from megalopta.assets_gen.plants.bark import TILE_M
from megalopta.assets_gen.plants.branching import Branching
from megalopta.assets_gen.plants.foliage import leaf_axes, place_leaves
from megalopta.assets_gen.plants.forms import grow_axes
from megalopta.assets_gen.plants.furrows import (
    BUTTRESSED_SIDES,
    Furrows,
    buttress_flare,
    root_flare,
)
from megalopta.assets_gen.plants.skeleton import IndexArray, Skeleton, axes, pipe_radii
from megalopta.assets_gen.plants.species import Species
from megalopta.assets_gen.plants.tube import sweep

BREAST_HEIGHT_M = 1.3
STEM_FINENESS = 0.3
"""Chord error of stems relative to that of branches."""


@dataclass(frozen=True)
class Plant:
    """Grown plant, with its foot at the origin."""

    species: Species
    branching: Branching
    radii_m: FloatArray
    """(n,): radius at every node of the skeleton."""
    axes: list[IndexArray]
    """Nodes of the skeleton along each axis, from base to tip."""
    tubes: tuple[Surface, ...]
    """One closed tube per axis."""
    twigs: FloatArray
    """(a, s, 3): axes that bear leaves, from base to tip; too thin to be drawn if they are side
    twigs (m)."""
    leaves: Surface

    @cached_property
    def tube_areas(self) -> FloatArray:
        """Area (a,) of each tube (m²)."""
        ends = np.cumsum([len(tube.faces) for tube in self.tubes])
        return np.array([part.sum() for part in np.split(self.wood.face_areas, ends[:-1])])

    @property
    def wood(self) -> Surface:
        """All tubes as one surface."""
        return join(self.tubes)


def grow_plant(
    species: Species,
    rng: np.random.Generator,
    fullness: float = 1.0,
    furrows: Furrows | None = None,
) -> Plant:
    """Return one individual of a species, with `fullness` times its leaves on the same wood.

    Its stems have furrows.
    """
    branching = grow_axes(species, rng)
    skeleton = branching.skeleton
    reference = min(BREAST_HEIGHT_M, species.height_m / 3)
    radii = pipe_radii(skeleton, species.disused_share, species.radius_m, reference)
    along = axes(skeleton, radii)
    tubes = tuple(bark_around(species, skeleton, radii, nodes, rng, furrows) for nodes in along)
    twigs = leaf_axes(skeleton.positions[branching.bearing], species.foliage, rng)
    foliage = species.foliage.model_copy(update={"per_m": fullness * species.foliage.per_m})
    leaves = place_leaves(twigs, foliage, rng)
    return Plant(species, branching, radii, along, tubes, twigs, leaves)


def bark_around(
    species: Species,
    skeleton: Skeleton,
    radii_m: FloatArray,
    nodes: IndexArray,
    rng: np.random.Generator,
    furrows: Furrows | None = None,
) -> Surface:
    """Return the tube around one axis, with only the rings and sides that its chord requires.

    Furrows of a stem need more. With any number of sides, the tube is as wide on average as the
    round branch that it represents.
    """
    is_stem, chord_m = skeleton.parents[nodes[0]] < 0, species.chord_m
    positions, radius = skeleton.positions[nodes], radii_m[nodes]
    if not is_stem:
        radius[0] = radius[1]  # the first node is inside the bearing axis and has its radius
    walls = species.buttresses if is_stem else None
    sides = BUTTRESSED_SIDES if walls else _sides(radius[0], chord_m)
    profile = np.repeat(radius[:, None] * _as_wide_as_a_circle(sides), sides, axis=1)
    if is_stem:
        profile *= root_flare(positions[:, 2], sides, radius[0], species.flare, rng)
    if walls:
        profile *= buttress_flare(positions[:, 2], sides, walls, rng)
    outline = np.column_stack([positions, profile.max(axis=1)])
    kept = simplified(outline, chord_m * (STEM_FINENESS if is_stem else 1))
    origin = rng.random(2)
    axis, rings = positions[kept], profile[kept][:-1]
    if is_stem and furrows:
        axis, rings = furrows.carved(axis, rings, TILE_M, origin)
    return sweep(axis, rings, TILE_M, origin, whole_tiles=is_stem)


def _sides(radius_m: float, chord_m: float) -> int:
    """Return the number of sides for a tube to look round at the detail of `chord_m`."""
    return int(np.interp(radius_m / chord_m, [0.3, 0.6, 1, 2], [3, 4, 6, 12]))


def _as_wide_as_a_circle(sides: int) -> float:
    """Return the circumradius of the regular polygon with the unit circle's circumference.

    By Cauchy's formula convex outlines of one circumference are equally wide on average.
    """
    return float(np.pi / (sides * np.sin(np.pi / sides)))


def simplified(points: FloatArray, tolerance: float) -> IndexArray:
    """Return the points of a polyline (k, d) that keep it within `tolerance` (Douglas–Peucker)."""
    keep = {0, len(points) - 1}
    spans = [(0, len(points) - 1)]
    while spans:
        low, high = spans.pop()
        if high - low < 2:
            continue
        chord = points[high] - points[low]
        inner = points[low + 1 : high] - points[low]
        share = (inner @ chord / max(chord @ chord, 1e-12)).clip(0, 1)
        error = lengths(inner - share[:, None] * chord)
        worst = int(error.argmax())
        if error[worst] > tolerance:
            keep.add(low + 1 + worst)
            spans += [(low, low + 1 + worst), (low + 1 + worst, high)]
    return np.array(sorted(keep))
