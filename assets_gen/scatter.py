"""Points scattered in the plane with a minimum distance (Poisson disk), and random generators.

There is one generator per purpose, so that adding a tree never changes the grass.
"""

from zlib import crc32

import numpy as np
from scipy.spatial import cKDTree

from megalopta.assets_gen import FloatArray

JAMMING = 0.547
"""Covered share of the plane, by disks of the minimum distance, when no further dart fits."""


def poisson_disk(
    low: FloatArray, high: FloatArray, count: int, spacing_m: float, rng: np.random.Generator
) -> FloatArray:
    """Return points (count, 2) of a box, from corner to corner (2,), in order of the throws.

    A dart nearer than `spacing_m` to an earlier one is rejected. Raises ValueError if the points
    would fill more than 90 % of the limit of random throwing.
    """
    cover = count * np.pi * spacing_m**2 / 4 / np.prod(high - low)
    if count > 1 and cover > 0.9 * JAMMING:
        raise ValueError(
            f"spacing_m: {count} points {spacing_m:g} m apart do not fit into "
            f"{high[0] - low[0]:g} m × {high[1] - low[1]:g} m; lower the density or the spacing"
        )
    kept = np.empty((0, 2))
    while len(kept) < count:
        darts = np.concatenate([kept, rng.uniform(low, high, (4 * count, 2))])
        earlier, later = cKDTree(darts).query_pairs(spacing_m, output_type="ndarray").T
        alive = np.ones(len(darts), dtype=bool)
        while len(earlier):
            open_ = np.zeros(len(darts), dtype=bool)
            open_[later] = True
            alive[later[~open_[earlier]]] = False  # too near to one that surely stays
            pending = alive[earlier] & alive[later]
            earlier, later = earlier[pending], later[pending]
        kept = darts[alive]
    return kept[:count]


def distance_to(points: cKDTree, places: FloatArray, within: float = np.inf) -> FloatArray:
    """Return the distance (n,) from each place (n, d) to the nearest of the points.

    It is infinite if none is nearer than `within`.
    """
    distance, _ = points.query(places, distance_upper_bound=within)
    return np.asarray(distance)


def generator(seed: int, *purpose: str | int) -> np.random.Generator:
    """Return the generator for a seed, 0 or more, and a purpose.

    The purpose is given from coarse to fine: ``generator(3, "tree", "beech", 2)``.
    """
    key = [crc32(part.encode()) if isinstance(part, str) else part for part in purpose]
    # The length comes first because numpy treats a seed's trailing zeros as padding.
    return np.random.default_rng([len(key), seed, *key])
