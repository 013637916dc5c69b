"""Whole plant: axes by its growth form, bark around them, leaves on its twigs.

Fronds of a palm are at the golden angle, the oldest lowest. Ropes of a liana hang between holds.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import map_coordinates

from megalopta.assets_gen import FloatArray, Surface, grid_faces, join, lengths, unit
from megalopta.assets_gen.plants import bark, branching
from megalopta.assets_gen.plants.bark import TILE_M, Furrows
from megalopta.assets_gen.plants.branching import GOLDEN_ANGLE, UP, Branching, outward, sideways
from megalopta.assets_gen.plants.foliage import leaf_axes, place_leaves
from megalopta.assets_gen.plants.skeleton import IndexArray, Skeleton, axes, pipe_radii, swept_tube
from megalopta.assets_gen.plants.species import Climbing, Colonized, Fronded, Species
from megalopta.assets_gen.tileable_noise import plane_waves
from megalopta.core.arrays import Mask


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
    leaves: Surface

    @cached_property
    def tube_areas(self) -> FloatArray:
        """Area (a,) of each tube (m²)."""
        ends = np.cumsum([len(tube.faces) for tube in self.tubes])
        return np.array([part.sum() for part in np.split(self.wood.face_areas, ends[:-1])])

    @cached_property
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
    grown = grow_axes(species, rng)
    skeleton = grown.skeleton
    reference = min(1.3, species.height_m / 3)
    radii = pipe_radii(skeleton, species.disused_share, species.radius_m, reference)
    along = axes(skeleton, radii)
    tubes = tuple(bark_around(species, skeleton, radii, along, rng, furrows=furrows))
    twigs = leaf_axes(skeleton.positions[grown.bearing], species.foliage, rng)
    foliage = species.foliage.model_copy(update={"per_m": fullness * species.foliage.per_m})
    leaves = place_leaves(twigs, foliage, rng)
    return Plant(species, grown, radii, along, tubes, leaves)


def bark_around(
    species: Species,
    skeleton: Skeleton,
    radii_m: FloatArray,
    along: Sequence[IndexArray],
    rng: np.random.Generator,
    factors: FloatArray | None = None,
    furrows: Furrows | None = None,
) -> list[Surface]:
    """Return the tube around each axis, with only the rings and sides that its chord requires.

    Radii are multiplied by the axis' factor. Furrows of a stem need more rings and sides. With any
    number of sides, a tube is as wide on average as the round branch that it represents.
    """
    factors = np.ones(len(along)) if factors is None else factors
    is_stem = skeleton.parents[[nodes[0] for nodes in along]] < 0
    tubes, origins = {}, np.empty((len(along), 2))
    for index, nodes in enumerate(along):
        if is_stem[index]:
            radius = factors[index] * radii_m[nodes]
            tubes[index] = _stem(species, skeleton.positions[nodes], radius, rng, furrows)
        else:
            origins[index] = rng.random(2)
    if not is_stem.all():
        branches = np.flatnonzero(~is_stem)
        nodes = np.concatenate([along[index] for index in branches.tolist()])
        sizes = np.array([len(along[index]) for index in branches.tolist()])
        first, positions = np.cumsum(sizes) - sizes, skeleton.positions[nodes]
        radius = np.repeat(factors[branches], sizes) * radii_m[nodes]
        radius[first] = radius[first + 1]  # the first node is inside the bearing axis
        sides = _sides(radius[first], species.chord_m)
        radius *= np.repeat(_circumradius(sides), sizes)
        kept = simplified(np.column_stack([positions, radius]), first, species.chord_m)
        rings, nodes = np.add.reduceat(kept, first, dtype=np.intp), np.flatnonzero(kept)
        first, shapes = np.cumsum(rings) - rings, np.stack([rings, sides])
        for count, around in np.unique(shapes, axis=1).T.tolist():
            alike = np.flatnonzero((rings == count) & (sides == around))
            rows, mine = nodes[first[alike][:, None] + np.arange(count)], branches[alike]
            profile = np.repeat(radius[rows[:, :-1], None], around, axis=2)
            swept = swept_tube(positions[rows], profile, TILE_M, origins[mine], whole_tiles=False)
            assert swept.normals is not None
            parts = zip(mine.tolist(), swept.vertices, swept.uv, swept.normals, strict=True)
            tubes |= {index: Surface(a, swept.faces, uv, b) for index, a, uv, b in parts}
    return [tubes[index] for index in range(len(along))]


def _stem(
    species: Species,
    positions: FloatArray,
    radius: FloatArray,
    rng: np.random.Generator,
    furrows: Furrows | None,
) -> Surface:
    """Return the tube around a stem of positions (k, 3) and radii (k,)."""
    walls = species.buttresses
    sides = bark.BUTTRESSED_SIDES if walls else int(_sides(radius[0], species.chord_m))
    profile = np.repeat((radius * _circumradius(sides))[:, None], sides, axis=1)
    profile *= bark.root_flare(positions[:, 2], sides, radius[0], species.flare, rng)
    if walls:
        profile *= bark.buttress_flare(positions[:, 2], sides, walls, rng)
    outline = np.column_stack([positions, profile.max(axis=1)])
    kept = simplified(outline, np.zeros(1, np.intp), 0.3 * species.chord_m)
    origin = rng.random(2)
    axis, rings = positions[kept], profile[kept][:-1]
    if furrows:
        axis, rings = furrows.carved(axis, rings, TILE_M, origin)
    return swept_tube(axis, rings, TILE_M, origin, whole_tiles=True)


MOSS_M, MOSS_TOP_M = 0.02, 1.4
"""Typical thickness of moss on bark, and height where it ends (m)."""


def moss_on(stem: Surface, step_m: float, rng: np.random.Generator) -> Surface:
    """Return moss around the foot of a stem made by `swept_tube`: a sleeve with steps of a size.

    Where it is thin, it is inside the stem, so that it ends in a ragged border.
    """
    columns = int(np.argmax(stem.uv[:, 1] != stem.uv[0, 1]))
    assert stem.normals is not None
    grid = np.concatenate([stem.vertices, stem.normals], axis=1)[:-1].reshape(-1, columns, 6)
    height = grid[:, :, 2].mean(axis=1)
    levels = np.arange(height[0], min(MOSS_TOP_M, height[-1]), step_m)
    girth_m = float(lengths(np.diff(grid[0, :, :3], axis=0)).sum())
    around = np.linspace(0, columns - 1, int(np.clip(girth_m / step_m, 10, 72)))
    rings = np.interp(levels, height, np.arange(len(height)))
    place = np.stack(np.meshgrid(rings, around, indexing="ij"))
    values = [map_coordinates(grid[..., axis], place, order=1) for axis in range(6)]
    points, normals = np.stack(values[:3], axis=-1), unit(np.stack(values[3:], axis=-1))
    z = points[..., 2]
    # A field of the plane, sheared with the height, has no seam around the stem.
    sheared = points[..., :2] + z[..., None] * (0.8, -0.6)
    cushions = plane_waves((0.06, 0.5), 1.0, 40, rng)(sheared)
    ample = rng.uniform(0.2, 1.2) + 0.6 * normals[..., 0] - 2.2 * np.maximum(z, 0) / MOSS_TOP_M
    thick = MOSS_M * np.tanh(0.7 * cushions + ample)
    faces = grid_faces(len(levels), len(around))
    uv = np.stack([points[..., :2].sum(axis=-1), z], axis=-1).reshape(-1, 2)
    vertices = (points + thick[..., None] * normals).reshape(-1, 3)
    return Surface(vertices, faces, uv, normals.reshape(-1, 3))


def _sides(radius_m: FloatArray, chord_m: float) -> IndexArray:
    """Return enough sides of tubes to look round at this detail."""
    return np.interp(radius_m / chord_m, [0.3, 0.6, 1, 2], [3, 4, 6, 12]).astype(np.intp)


def _circumradius(sides: IndexArray | int) -> FloatArray:
    """Return that of outlines as wide on average (Cauchy's formula) as a circle of radius 1."""
    return np.asarray(np.pi / (sides * np.sin(np.pi / sides)))


def simplified(points: FloatArray, first: IndexArray, tolerance: float) -> Mask:
    """Return a mask (n,) of the points (n, d) that keep polylines within `tolerance`.

    Polylines begin at the points `first` (Douglas–Peucker).
    """
    low, high = first, np.append(first[1:], len(points)) - 1
    keep = np.zeros(len(points), dtype=bool)
    keep[low] = keep[high] = True
    while (wide := high - low > 1).any():
        low, high = low[wide], high[wide]
        count = high - low - 1
        begin, span = np.cumsum(count) - count, np.repeat(np.arange(len(low)), count)
        inner = np.arange(len(span)) + (low + 1 - begin)[span]
        chord, away = points[high] - points[low], points[inner] - points[low[span]]
        square = np.maximum(np.vecdot(chord, chord), 1e-12)
        share = (np.vecdot(away, chord[span]) / square[span]).clip(0, 1)
        error = lengths(away - share[:, None] * chord[span])
        worst = np.lexsort((-error, span))[begin]
        cut = error[worst] > tolerance
        worst = inner[worst[cut]]
        keep[worst] = True
        low, high = np.append(low[cut], worst), np.append(worst, high[cut])
    return keep


NODES = 7
"""Internodes of a frond."""


def grow_fronded(species: Species, growth: Fronded, rng: np.random.Generator) -> Branching:
    """Return the axes of one palm; each frond bears leaflets from the stem to its tip."""
    age = (np.arange(growth.fronds) + 0.5) / growth.fronds
    share = np.arange(1, NODES + 1) / NODES
    skeleton = Skeleton(np.empty((0, 3)), np.empty(0, dtype=np.intp))
    bearing: list[IndexArray] = []
    for stem in range(species.stems):
        height = species.height_m - 0.45 * growth.frond_m
        height *= rng.uniform(0.5, 1) if stem else 1
        axis = branching.stem_axis(max(height, 0.6), species.wander, 0.6, rng)
        if species.stems > 1:
            axis += 0.5 * outward(np.array([stem * GOLDEN_ANGLE]))
        skeleton = skeleton.with_chain(axis)
        azimuth = GOLDEN_ANGLE * np.arange(growth.fronds) + rng.normal(0, 0.2, growth.fronds)
        raised = np.radians(np.interp(age, [0, 1], growth.raised_deg[::-1]))
        raised += rng.normal(0, 0.1, growth.fronds)
        bend = growth.bend * share**1.5 * rng.uniform(0.8, 1.3, (growth.fronds, 1))
        elevation = raised[:, None] - bend
        sway = outward(azimuth)[:, None] + 0.08 * rng.normal(0, 1, (growth.fronds, NODES, 3))
        heading = np.cos(elevation)[..., None] * sway + np.sin(elevation)[..., None] * UP
        length = growth.frond_m * rng.uniform(0.75, 1, growth.fronds) / NODES
        along = axis[-1] + np.cumsum(length[:, None, None] * unit(heading), axis=1)
        end = len(skeleton.positions) - 1
        nodes = end + 1 + np.arange(growth.fronds * NODES).reshape(growth.fronds, NODES)
        foot = np.full((growth.fronds, 1), end)
        bearing.append(np.concatenate([foot, nodes], axis=1))
        skeleton = skeleton.extended(along.reshape(-1, 3), bearing[-1][:, :-1].ravel())
    return Branching(skeleton, np.concatenate(bearing))


STEP_M = 0.45
HOLDS = 4
"""Number of holds of a rope, including its upper end."""


def grow_climbing(species: Species, growth: Climbing, rng: np.random.Generator) -> Branching:
    """Return the axes of one liana of `species.stems` ropes."""
    skeleton = Skeleton(np.empty((0, 3)), np.empty(0, dtype=np.intp))
    bearing: list[IndexArray] = []
    for rope in range(species.stems):
        azimuth = rope * GOLDEN_ANGLE + rng.normal(0, 0.4)
        height = species.height_m * rng.uniform(0.8, 1)
        levels = np.sort(rng.uniform(0.25, 0.9, HOLDS - 1))
        z = np.concatenate([[-branching.BURIED_M], height * levels, [height]])
        away = growth.reach_m * np.concatenate([[0.0], rng.uniform(0.1, 1, HOLDS)])
        turns = azimuth + rng.normal(0, 0.7, HOLDS + 1)
        holds = away[:, None] * outward(turns) + z[:, None] * UP
        pieces = [holds[:1]]
        for low, high, sag in zip(holds[:-1], holds[1:], rng.uniform(0, 0.2, HOLDS), strict=True):
            span = float(np.linalg.norm(high - low))
            share = np.linspace(0, 1, 2 + int(span / STEP_M))[1:, None]
            slack = 4 * share * (1 - share)
            wave = np.sin(2 * np.pi * share + rng.uniform(0, 2 * np.pi)) * slack
            across = outward(rng.uniform(0, 2 * np.pi, 1))
            slackened = low + share * (high - low) + sag * span * slack * across
            pieces.append(slackened + 0.06 * wave * across)
        line = np.concatenate(pieces)
        first = len(skeleton.positions)
        skeleton = skeleton.with_chain(line)
        bearers = np.sort(rng.integers(len(line) // 2, len(line), growth.shoots)) + first
        ahead = unit(skeleton.internodes()[bearers])
        toward = sideways(ahead, rng.uniform(0, 2 * np.pi, len(bearers))) - 0.4 * UP
        ends = skeleton.positions[bearers] + growth.shoot_m * unit(toward)
        bearing.append(np.stack([bearers, len(skeleton.positions) + np.arange(len(ends))], axis=-1))
        skeleton = skeleton.extended(ends, bearers)
    return Branching(skeleton, np.concatenate(bearing))


def grow_axes(species: Species, rng: np.random.Generator) -> Branching:
    """Return the axes of one plant; the stem's foot is at the origin."""
    match species.growth:
        case Colonized() as growth:
            return branching.grow_colonized(species, growth, rng)
        case Fronded() as growth:
            return grow_fronded(species, growth, rng)
        case Climbing() as growth:
            return grow_climbing(species, growth, rng)
        case growth:
            return branching.grow_whorled(species, growth, rng)
