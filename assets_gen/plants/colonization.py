"""Branching by space colonization.

Points strewn into the crown attract the nearest node of the skeleton; a node grows one step toward
the mean direction of the points it attracts; a point that was reached is removed (Runions, Lane &
Prusinkiewicz 2007, "Modeling trees with a space colonization algorithm"). The trunk and the first-
order branches are set beforehand, which keeps the species' branching angle; only branches grow on,
never the bare trunk.
"""

import numpy as np
from scipy.spatial import cKDTree

from megalopta.assets_gen import FloatArray, unit
from megalopta.assets_gen.plants.skeleton import IndexArray, Skeleton
from megalopta.assets_gen.plants.species import Crown

KILL_STEPS = 1.6
"""A point counts as reached when a node is this many steps away."""
MAX_CHILDREN = 3
"""A node forks into no more branches than this."""
DEFLECTION = 0.12
"""Random part of a step's direction, standard deviation in units of the pull."""


def crown_points(crown: Crown, height_m: float, count: int, rng: np.random.Generator) -> FloatArray:
    """Return attraction points inside the crown, shape (count, 3) (m), stem at x = y = 0.

    They are a little denser toward the outside, where the light is. The crown's radius varies
    around the stem by two random harmonics, so that no two crowns have the same sides.
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
    """Return the crown's radius (m) at a share `level` of the way from its base to its top."""
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
    """Return the skeleton grown into the attraction points.

    Parameters
    ----------
    buds : (b,)
        The nodes that may grow.
    points : (p, 3)
        Attraction points (m).
    step_m : float
        Length of an internode (m).
    tropism : float
        Upward pull, in units of the pull of the points.
    """
    distance, nearest = np.full(len(points), np.inf), np.zeros(len(points), dtype=np.intp)
    while len(buds) and len(points):
        _attach(points, distance, nearest, skeleton.positions, buds)
        unreached = distance > KILL_STEPS * step_m
        points, distance, nearest = points[unreached], distance[unreached], nearest[unreached]
        growing, pull = _pulls(points, nearest, skeleton)
        pull += (0, 0, tropism) + DEFLECTION * rng.standard_normal(pull.shape)
        tips = skeleton.positions[growing] + step_m * unit(pull)
        buds = len(skeleton.positions) + np.arange(len(growing))
        skeleton = skeleton.extended(tips, growing)
    return skeleton


def _attach(
    points: FloatArray,
    distance: FloatArray,
    nearest: IndexArray,
    positions: FloatArray,
    buds: IndexArray,
) -> None:
    """Hand points over, in place, to new buds that are closer than their nearest node."""
    new_distance, which = cKDTree(positions[buds]).query(points)
    closer = np.asarray(new_distance) < distance
    distance[closer] = np.asarray(new_distance)[closer]
    nearest[closer] = buds[np.asarray(which)[closer]]


def _pulls(
    points: FloatArray, nearest: IndexArray, skeleton: Skeleton
) -> tuple[IndexArray, FloatArray]:
    """Return the nodes that grow and the mean direction (n, 3) to the points they attract."""
    nodes, owner, count = np.unique(nearest, return_inverse=True, return_counts=True)
    pull = np.zeros((len(nodes), 3))
    np.add.at(pull, owner, unit(points - skeleton.positions[nearest]))
    free = skeleton.child_counts()[nodes] < MAX_CHILDREN
    return nodes[free], pull[free] / count[free, None]
