"""Neighboring clusters told apart only as far as their light differs by more than its noise.

In a voxel some pixels wide the light of clusters that face the same way varies by τ², and what is
known of each by its noise v. Of a cluster's distance from their mean the part τ²/(τ² + v) is kept,
which has the least mean square error (James and Stein, 1961): where light is even the clusters
share their samples, and where shadows fall each keeps its own. Half differences then stand for the
whole error, with what is taken of true contrast.
"""

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats


def smoothed(
    rows: Floats, neighbors: NDArray[np.uint64], rays: NDArray[np.int64], seen: NDArray[np.int64]
) -> Floats:
    """Rows (C, 2·n) of clusters: n values, and half the differences of two halves of each.

    Clusters with equal numbers are neighbors; `rays` of each tell how well it is known.
    """
    _, group = np.unique(neighbors, return_inverse=True)
    n = rows.shape[1] // 2
    light, apart = rows[:, :n].sum(axis=1), rows[:, n:].sum(axis=1)

    def total(values: Floats) -> Floats:
        return np.asarray(np.bincount(group, values), np.float64)

    count, weight = total(np.ones(len(rows))), total(rays.astype(float))
    # Of one ray: what halves are apart by has the variance of the mean.
    of_a_ray = total(rays * apart**2) / count
    mean = total(rays * light) / weight
    noise = of_a_ray[group] / rays
    # As often as pixels show them: what counts is the contrast that is seen.
    shown = total(seen.astype(float))
    spread = total(seen * ((light - mean[group]) ** 2 - noise * (1 - rays / weight[group]))) / shown
    contrast = np.maximum(spread * count / np.maximum(count - 1, 1), 0)[group]
    kept = np.where(contrast + noise > 0, contrast / np.maximum(contrast + noise, 1e-300), 1.0)
    kept = np.where(count[group] > 1, kept, 1.0)[:, None]
    # The least mean square error is v·kept: the part of the noise that is kept, and of the contrast
    # that is not. Half differences are to have it as theirs.
    kept = np.concatenate([np.tile(kept, n), np.tile(np.sqrt(kept), n)], axis=1)
    means = np.stack([total(rays * column) / weight for column in rows.T], axis=1)
    return np.asarray(means[group] + kept * (rows - means[group]))
