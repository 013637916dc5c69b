"""Axes of a plant, grown from its species' data: stem, branches and leafy twigs.

Branches grow by space colonization (Runions, Lane & Prusinkiewicz 2007, "Modeling trees with a
space colonization algorithm"), from a trunk and first-order branches that are set beforehand.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from megalopta.assets_gen import FloatArray, cross, unit
from megalopta.assets_gen.plants.skeleton import IndexArray, Skeleton, relaxed, sum_toward_root
from megalopta.assets_gen.plants.species import Colonized, Crown, Species, Whorled


def crown_points(crown: Crown, height_m: float, count: int, rng: np.random.Generator) -> FloatArray:
    """Return attraction points inside the crown, shape (count, 3) (m), stem at x = y = 0.

    They are slightly denser toward the outside, where the light is. The crown's radius varies
    around the stem by two random harmonics, so that all crowns differ.
    """
    levels = np.linspace(0, 1, 256)
    radius = profile_radius(crown, levels)
    volume = np.cumsum(radius**2)
    level = np.interp(rng.random(count), volume / volume[-1], levels)
    azimuth = rng.uniform(0, 2 * np.pi, count)
    phases = rng.uniform(0, 2 * np.pi, 2)
    lobes = 1 + 0.16 * np.cos(azimuth + phases[0]) + 0.12 * np.cos(2 * azimuth + phases[1])
    distance = profile_radius(crown, level) * lobes * rng.random(count) ** 0.4
    z = height_m * (crown.base + (1 - crown.base) * level)
    return np.stack([distance * np.cos(azimuth), distance * np.sin(azimuth), z], axis=-1)


def profile_radius(crown: Crown, level: FloatArray) -> FloatArray:
    """Return the crown's radius (m) at a fraction `level` of its height, from base to top."""
    steps = np.linspace(0, 1, len(crown.profile))
    return crown.radius_m * np.interp(level, steps, crown.profile)


def colonize(
    skeleton: Skeleton,
    buds: IndexArray,
    points: FloatArray,
    step_m: float,
    tropism: float,
    rng: np.random.Generator,
) -> Skeleton:
    """Return the skeleton grown from buds (b,) into attraction points (p, 3) (m), step by step.

    Tropism is the upward pull, relative to the pull of the points. A node reaches points within
    1.6 steps, and a fork has at most three branches.
    """
    distance, nearest = np.full(len(points), np.inf), np.zeros(len(points), dtype=np.intp)
    while len(buds) and len(points):
        new_distance, which = cKDTree(skeleton.positions[buds]).query(points)
        closer = np.asarray(new_distance) < distance
        distance[closer] = np.asarray(new_distance)[closer]
        nearest[closer] = buds[np.asarray(which)[closer]]
        unreached = distance > 1.6 * step_m
        points, distance, nearest = points[unreached], distance[unreached], nearest[unreached]
        nodes, owner, count = np.unique(nearest, return_inverse=True, return_counts=True)
        pull = np.zeros((len(nodes), 3))
        np.add.at(pull, owner, unit(points - skeleton.positions[nearest]))
        free = skeleton.child_counts()[nodes] < 3
        growing, pull = nodes[free], pull[free] / count[free, None]
        pull += (0, 0, tropism) + 0.12 * rng.standard_normal(pull.shape)
        tips = skeleton.positions[growing] + step_m * unit(pull)
        buds = len(skeleton.positions) + np.arange(len(growing))
        skeleton = skeleton.extended(tips, growing)
    return skeleton


GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
UP = np.array([0.0, 0.0, 1.0])
BURIED_M = 0.35
"""Depth of stems in the ground, so that none hangs in the air on a slope."""
FOOT_M = (0.0, 0.1, 0.25, 0.5)
"""Heights at which the stem's widening into roots is resolved."""


@dataclass(frozen=True)
class Branching:
    """Skeleton with the axes that bear leaves."""

    skeleton: Skeleton
    bearing: IndexArray
    """(a, s): node indices, from base to tip, of the twigs that bear leaves; all have s nodes."""


def outward(azimuth: FloatArray) -> FloatArray:
    """Return horizontal unit vectors (n, 3)."""
    return np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], axis=-1)


def sideways(direction: FloatArray, turn: FloatArray) -> FloatArray:
    """Return unit vectors across `direction` (n, 3), turned about it; 0 is horizontal."""
    level = unit(cross(direction, UP) + 1e-9)
    return np.cos(turn)[:, None] * level + np.sin(turn)[:, None] * cross(level, direction)


def stem_axis(
    height_m: float, wander: float, step_m: float, rng: np.random.Generator
) -> FloatArray:
    """Return a slightly wandering stem from below the ground to `height_m`, shape (k, 3) (m).

    The sideways drift is the sum of three sines of random direction whose amplitudes fall with
    their frequency; it is zero at the ground.
    """
    z = np.linspace(FOOT_M[-1] + step_m, height_m, 2 + int(height_m / step_m))
    z = np.concatenate([[-BURIED_M, *FOOT_M], z])
    order = np.arange(1, 4)
    phase, azimuth = rng.uniform(0, 2 * np.pi, (2, 3))
    waves = np.sin(np.pi * order * z[:, None] / height_m + phase) - np.sin(phase)
    waves *= wander * height_m / order**2
    return np.stack([waves @ np.cos(azimuth), waves @ np.sin(azimuth), z], axis=-1)


def grow_colonized(species: Species, growth: Colonized, rng: np.random.Generator) -> Branching:
    """Return the axes of a broad-leaved tree or bush, which fills its crown."""
    first_azimuth = rng.uniform(0, 2 * np.pi)
    skeleton = Skeleton(np.empty((0, 3)), np.empty(0, dtype=np.intp))
    buds: list[IndexArray] = []
    for stem in range(species.stems):
        azimuth = first_azimuth + stem * GOLDEN_ANGLE
        several = species.stems > 1
        # Above the stem there are only branches that grow from its end.
        top = 0.88 * species.height_m * (rng.uniform(0.6, 1) if several else 1)
        axis = stem_axis(top, species.wander, growth.step_m, rng)
        if several:
            level = np.clip(axis[:, 2:] / species.height_m, 0, 1)
            reach = 0.08 + 0.6 * species.crown.radius_m * level**1.3
            axis += reach * (np.cos(azimuth), np.sin(azimuth), 0)
        nodes = len(skeleton.positions) + np.arange(len(axis))
        skeleton, ends = _with_scaffold(skeleton.with_chain(axis), nodes, species, growth, rng)
        buds.append(ends)
    points = crown_points(species.crown, species.height_m, growth.points, rng)
    grown = colonize(skeleton, np.concatenate(buds), points, growth.step_m, growth.tropism, rng)
    return _with_shoots(relaxed(grown, 2), growth, rng)


def _with_scaffold(
    skeleton: Skeleton,
    stem: IndexArray,
    species: Species,
    growth: Colonized,
    rng: np.random.Generator,
) -> tuple[Skeleton, IndexArray]:
    """Add first-order branches; return the nodes that keep growing: their ends and the stem's."""
    count = growth.scaffold
    z = skeleton.positions[stem, 2]
    low = species.crown.base * species.height_m
    heights = low + (z[-1] - low) * (np.arange(count) + 0.3) / count
    bearers = stem[np.searchsorted(z, heights).clip(1, len(z) - 1)]
    azimuth = rng.uniform(0, 2 * np.pi) + GOLDEN_ANGLE * np.arange(count)
    azimuth += rng.normal(0, 0.25, count)
    angle = np.radians(growth.insertion_deg) + rng.normal(0, 0.12, count)
    direction = np.sin(angle)[:, None] * outward(azimuth) + np.cos(angle)[:, None] * UP
    inner = skeleton.positions[bearers] + growth.step_m * direction
    outer = inner + growth.step_m * unit(direction + 0.1 * UP)
    first = len(skeleton.positions) + np.arange(count)
    grown = skeleton.extended(inner, bearers).extended(outer, first)
    return grown, np.concatenate([stem[-1:], first + count])


def _with_shoots(skeleton: Skeleton, growth: Colonized, rng: np.random.Generator) -> Branching:
    """Add leafy twigs of two internodes to the tips, and along branches of up to three tips."""
    is_tip = skeleton.child_counts() == 0
    is_thin = sum_toward_root(skeleton, is_tip.astype(float)) <= 3
    tips = np.flatnonzero(is_tip)
    lateral = rng.permutation(np.tile(np.flatnonzero(is_thin & ~is_tip), 2))
    bearers = np.concatenate([tips, np.sort(lateral[: max(growth.shoots - len(tips), 0)])])
    ahead = unit(skeleton.internodes()[bearers])
    turn = GOLDEN_ANGLE * np.arange(len(bearers)) + rng.normal(0, 0.3, len(bearers))
    spread = np.where(is_tip[bearers], 0.25, 1.1)[:, None]
    down = -growth.shoot_droop * UP
    half = growth.shoot_m / 2 * rng.uniform(0.7, 1.2, (len(bearers), 1))
    start = unit(ahead + spread * sideways(ahead, turn) + 0.5 * down)
    middle = skeleton.positions[bearers] + half * start
    end = middle + half * unit(start + 1.5 * down)
    first = len(skeleton.positions) + np.arange(len(bearers))
    grown = skeleton.extended(middle, bearers).extended(end, first)
    return Branching(grown, np.stack([bearers, first, first + len(bearers)], axis=-1))


def grow_whorled(species: Species, growth: Whorled, rng: np.random.Generator) -> Branching:
    """Return the axes of a spruce or fir: tiers of branches around a straight leader."""
    axis = stem_axis(species.height_m, species.wander, growth.spacing_m / 2, rng)
    stem = Skeleton(axis, np.arange(-1, len(axis) - 1))
    low = species.crown.base * species.height_m
    tiers = np.arange(low, axis[-1, 2] - 0.3, growth.spacing_m)
    count = len(tiers) * growth.branches
    heights = np.repeat(tiers, growth.branches) + growth.spacing_m / 6 * rng.standard_normal(count)
    bearers = np.searchsorted(axis[:, 2], heights).clip(1, len(axis) - 2)
    azimuth = np.repeat(rng.uniform(0, 2 * np.pi, len(tiers)), growth.branches)
    azimuth += 2 * np.pi * np.arange(count) / growth.branches
    azimuth += rng.normal(0, 0.2, count)
    level = ((axis[bearers, 2] - low) / (species.height_m - low)).clip(0, 1)
    angle = np.radians(np.interp(level, [0, 1], growth.insertion_deg))
    angle += rng.normal(0, 0.08, len(level))
    length = profile_radius(species.crown, level) * rng.uniform(0.75, 1.12, len(level))
    # branches sag, and rise again at the tip
    sag = growth.droop * (1 - 0.6 * level)
    share = np.array([0.25, 0.5, 0.75, 1.0])
    out = share * np.sin(angle)[:, None]
    up = share * np.cos(angle)[:, None] - sag[:, None] * np.sin(np.pi * share**0.8)
    shape = out[..., None] * outward(azimuth)[:, None] + up[..., None] * UP
    nodes = axis[bearers, None] + length[:, None, None] * shape
    first = len(axis) + np.arange(nodes[..., 0].size).reshape(nodes.shape[:2])
    bearing = np.concatenate([bearers[:, None], first], axis=1)
    return Branching(stem.extended(nodes.reshape(-1, 3), bearing[:, :-1].ravel()), bearing)
