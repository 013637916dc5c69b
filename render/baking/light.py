"""Baked light: the radiance of clusters of cells, computed once and looked up.

Clusters differ from their neighbors only as far as their light differs by more than its noise. In a
voxel some pixels wide, the light of clusters of the same orientation varies by τ², and each
estimate by its noise v. The part τ²/(τ² + v) of a cluster's deviation from their mean is kept,
which minimizes the mean square error (James and Stein, 1961). Half differences then represent the
whole error, including lost contrast.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Ints
from megalopta.core.progress import progress
from megalopta.render import dr, mi
from megalopta.render.baking.cells import Cells, UInt32
from megalopta.render.baking.gathering import STRIDE, Gatherer
from megalopta.render.shading import Weights, mixed

DRAWS = 32
"""Cells per cluster at which light is gathered."""


@dataclass(frozen=True)
class Clusters:
    """Cells in C clusters, sorted by cluster."""

    members: UInt32
    first: Ints
    """(C + 1,): index of the first member of each cluster, and the number of members."""
    weight: Ints
    """Cumulative number of times that members were seen, from 1 on."""
    places: UInt32
    """Place where each member was seen once."""

    @classmethod
    def of(cls, cell: UInt32, keys: NDArray[np.uint64], seen: UInt32, places: UInt32) -> "Clusters":
        """Cluster cells (N,) by their keys; `seen` is the number of times each was seen."""
        order = np.argsort(keys, kind="stable")
        ends = np.flatnonzero(np.diff(keys[order])) + 1
        first = np.concatenate([[0], ends, [len(cell)]]) if len(cell) else np.zeros(1)
        weight = np.cumsum(seen[order], dtype=np.int64)
        return cls(cell[order], first.astype(np.int64), weight, places[order])

    def __len__(self) -> int:
        return len(self.first) - 1

    @property
    def leaders(self) -> UInt32:
        """(C,): first member of each cluster."""
        return self.members[self.first[:-1]]

    @property
    def seen(self) -> Ints:
        """(C,): number of times that members were seen."""
        return np.diff(np.concatenate([[0], self.weight])[self.first])

    def draws(self, chosen: Ints) -> tuple[UInt32, UInt32]:
        """Members (C, DRAWS) of chosen clusters (C,), in proportion to how often each was seen.

        Also the place where each was seen once.
        """
        before = np.concatenate([[0], self.weight])[self.first[chosen]]
        steps = (np.arange(DRAWS) + 0.5) / DRAWS
        weight = before[:, None] + steps * self.seen[chosen][:, None]
        drawn = np.searchsorted(self.weight, weight, side="right")
        return self.members[drawn], self.places[drawn]


def smoothed(
    rows: NDArray[np.floating], neighbors: NDArray[np.uint64], rays: Ints, seen: Ints
) -> NDArray[np.floating]:
    """Smoothed rows (C, 2·n) of clusters: n values, and half the differences of their two halves.

    Clusters with equal numbers are neighbors; `rays` of each give its precision.
    """
    _, group = np.unique(neighbors, return_inverse=True)
    n = rows.shape[1] // 2
    light, half_difference = (rows[:, half].sum(axis=1, dtype=np.float64) for half in np.s_[:n, n:])

    def total(values: Floats) -> Floats:
        return np.asarray(np.bincount(group, values), np.float64)

    count, weight = total(np.ones(len(rows))), total(rays.astype(float))
    # For one ray: the difference of halves has the variance of the mean.
    of_a_ray = total(rays * half_difference**2) / count
    mean = total(rays * light) / weight
    noise = of_a_ray[group] / rays
    # Weighted by how often pixels show them: visible contrast matters.
    shown = total(seen.astype(float))
    spread = total(seen * ((light - mean[group]) ** 2 - noise * (1 - rays / weight[group]))) / shown
    contrast = np.maximum(spread * count / np.maximum(count - 1, 1), 0)[group]
    kept = np.where(contrast + noise > 0, contrast / np.maximum(contrast + noise, 1e-300), 1.0)
    kept = np.where(count[group] > 1, kept, 1.0)
    # The minimum mean square error is v·kept: the part of the noise that is kept, and of the
    # contrast that is lost. Half differences should have this error.
    shrunk = np.empty_like(rows)
    for column, values in enumerate(rows.T):  # one by one: rows are large
        level = (total(rays * values) / weight)[group]
        shrunk[:, column] = level + (kept if column < n else np.sqrt(kept)) * (values - level)
    return shrunk


NOT_LINKED, NOT_SURVEYED = 2**32 - 1, 2**32 - 2
"""Placeholders for the cluster of a cell: not looked up yet, and not met by the survey."""
_PAGE = 64
"""Cells of a page: of a forest's, less than one in a hundred is seen, and neighbors together."""
LEAST_RAYS = 2 * STRIDE
"""Fewest rays of a cluster, both halves together."""
_MOST_RAYS = 2**14

# The error falls as the rays to the power −0.42: for independent rays it would be −0.5, but with
# more rays clusters share less. 20 trees, 32 px: from 7.5 to 2.5 % where −0.5 would give 1.9 %.
_EXPONENT = 0.5 / 0.42

_KEPT = 2**16
"""Clusters at once whose paths' light is kept."""
# Rays traced at once, in about a second: results are held until they are summed, and Ctrl-C waits
# for them.
RAYS_AT_ONCE = 2**20
# Voxel size for smoothing clusters, over that of clusters: 2² times as wide.
OCTAVES = 2


class BakedLight:
    """Radiance of the cells that a survey met, without direct light from the sun's disc.

    For each cluster and band the table holds the radiance of each spectrum that a texture mixes,
    and of each half the difference of two halves of the samples.

    A cluster's noise counts by its area in the frames: a given number of rays leaves the least
    noise if they are in proportion to that and to the cluster's brightness.
    """

    def __init__(
        self, gatherer: Gatherer, cells: Cells, bands: int, survey: tuple[UInt32, UInt32, UInt32]
    ) -> None:
        self._gatherer, self._cells = gatherer, cells
        self._bands, self._columns = bands, gatherer.spectra * bands
        cell, seen, places = survey
        keys = cells.voxels(cell)
        self._clusters, self._keys = Clusters.of(cell, keys, seen, places), np.unique(keys)
        self._neighbors = cells.voxels(self._clusters.leaders, OCTAVES)
        # Of each voxel the cluster that is seen most often stands for cells that were not met.
        most = np.lexsort((-self._clusters.seen, self._neighbors))
        self._near, first = np.unique(self._neighbors[most], return_index=True)
        self._standing_in = most[first]
        self._weight = gatherer.brightness(self._clusters.leaders) * self._clusters.seen
        # Cells of the first page are not linked.
        self._page_of = dr.zeros(mi.UInt, cells.count // _PAGE + 1)
        self._cluster_of = mi.UInt(np.full(_PAGE, NOT_LINKED, np.uint32))

    def _shares(self, density: float) -> Ints:
        """Number of rays of each cluster, relative to the fewest, for one of rays per view."""
        rays = (density * self._weight).clip(1, _MOST_RAYS)
        return np.ceil(rays / LEAST_RAYS).astype(np.int64)

    def rays(self, density: float) -> int:
        """Total number of rays of all clusters."""
        return int(self._shares(density).sum()) * LEAST_RAYS

    def density_for(self, share: float, density: float) -> float:
        """Rays per view of a cluster that reduce the error at a density to a share of it."""

        def error(density: float) -> float:
            return math.sqrt(np.sum(self._weight**2 / self._shares(density)))

        now = error(density)
        while error(density) > now * share**_EXPONENT and density < _MOST_RAYS:
            density *= 1.1
        return density

    def prepare(self) -> None:
        """Keep light of surfaces that clusters see."""
        clusters = self._clusters
        if not len(clusters):
            return
        parts = np.split(np.arange(len(clusters)), np.arange(_KEPT, len(clusters), _KEPT))
        draws = ((x[:, :: DRAWS // 4] for x in clusters.draws(part)) for part in parts)
        leaders = (clusters.leaders[part] for part in parts)
        self._gatherer.keep(
            (leader, *places) for leader, places in zip(leaders, draws, strict=True)
        )

    def compute_all(self, density: float) -> None:
        """Compute the light of all clusters, and link their cells to them."""
        clusters = self._clusters
        self.compute(np.arange(len(clusters)), density)
        numbers = np.repeat(np.arange(len(clusters)), np.diff(clusters.first))
        if len(numbers):
            self._link(clusters.members, numbers)

    def compute(self, clusters: Ints, density: float) -> None:
        """Compute the light of clusters, by number, with progress, as measured by two halves."""
        shares = self._shares(density)[clusters]
        rows = np.zeros((len(clusters), 2 * self._columns), np.float32)
        launch = np.cumsum(LEAST_RAYS * shares) // RAYS_AT_ONCE
        ends = np.flatnonzero(np.diff(launch)) + 1
        parts = np.split(np.arange(len(launch)), ends) if len(launch) else []
        with progress("Computing light on surfaces", len(parts), "part") as advance:
            for part in parts:
                chosen = clusters[part]
                leaders, drawn = self._clusters.leaders[chosen], self._clusters.draws(chosen)
                halves = self._gatherer.leaving(
                    leaders, *drawn, shares=shares[part], least=LEAST_RAYS // 2
                )
                half_differences = (halves[:, 0] - halves[:, 1]) / 2
                rows[part] = np.concatenate([halves.mean(axis=1), half_differences], axis=1)
                advance()
        table = np.zeros((max(len(self._clusters), 1), 2 * self._columns), np.float32)
        if len(clusters):
            seen = self._clusters.seen[clusters]
            table[clusters] = smoothed(rows, self._neighbors[clusters], shares, seen)
        self._values = mi.Float(table.ravel())

    def clusters_of(self, cell: UInt32) -> Ints:
        """Clusters of cells (N,), by number, or near ones; `NOT_SURVEYED` if there is none."""
        exact = 0, self._keys, np.arange(len(self._keys))
        cluster = np.full(len(cell), NOT_SURVEYED)
        for octaves, keys, of in (exact, (OCTAVES, self._near, self._standing_in)):
            left = np.flatnonzero(cluster == NOT_SURVEYED)
            if len(keys) and len(left):
                key = self._cells.voxels(cell[left], octaves)
                place = np.searchsorted(keys, key).clip(max=len(keys) - 1)
                cluster[left] = np.where(keys[place] == key, of[place], NOT_SURVEYED)
        return cluster

    def look_up(self, cell: Any, active: Any) -> tuple[Any, Any]:
        """Clusters of active cells (N,), already evaluated, and True for those with light."""
        cluster = self._linked(cell, active)
        lanes: Any = dr.compress(active & (cluster == NOT_LINKED))
        if dr.width(lanes):
            new = np.unique(np.array(dr.gather(mi.UInt, cell, lanes)))
            self._link(new, self.clusters_of(new))
            cluster = self._linked(cell, active)
        return cluster, active & (cluster < NOT_SURVEYED)

    def _linked(self, cell: Any, active: Any) -> Any:
        page = dr.gather(mi.UInt, self._page_of, cell // _PAGE, active)
        return dr.gather(mi.UInt, self._cluster_of, page * _PAGE + cell % _PAGE, active)

    def _link(self, cell: UInt32, cluster: Ints) -> None:
        number, index = np.unique(cell // _PAGE, return_inverse=True)
        page = np.array(dr.gather(mi.UInt, self._page_of, mi.UInt(number)))
        new, known = np.flatnonzero(page == 0), np.array(self._cluster_of)
        page[new] = len(known) // _PAGE + np.arange(len(new))
        linked = np.concatenate([known, np.full(_PAGE * len(new), NOT_LINKED, np.uint32)])
        linked[page[index] * _PAGE + cell % _PAGE] = cluster
        dr.scatter(self._page_of, mi.UInt(page), mi.UInt(number))
        self._cluster_of = mi.UInt(linked)
        dr.eval(self._page_of)
        dr.sync_thread()

    def radiance(self, cluster: Any, weights: Weights, active: Any) -> list[Any]:
        """Radiance of each band leaving cells of clusters (N,) with texture weights (N,)."""
        return self._mixed(0, cluster, weights, active)

    def standing(self, cluster: Any, weights: Weights, active: Any) -> list[Any]:
        """Half the difference of both halves of `radiance`; its deviation is the error."""
        return self._mixed(self._columns, cluster, weights, active)

    def _mixed(self, column: int, cluster: Any, weights: Weights, active: Any) -> list[Any]:
        first = cluster * (2 * self._columns) + column
        values = [
            dr.gather(mi.Float, self._values, first + k, active) for k in range(self._columns)
        ]
        return [mixed(values[band :: self._bands], weights) for band in range(self._bands)]
