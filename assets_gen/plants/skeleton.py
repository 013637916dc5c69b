"""Axes of a plant as a tree of nodes, with their thickness.

Thickness follows the pipe model (Shinozaki et al. 1964, Jpn. J. Ecol. 14:97), which contains
Leonardo's rule: every tip is supplied by one pipe of fixed cross-section that runs down to the
root, so that the areas of the branches above a fork add up to the area below it. Pipes of shed
leaves stay in the wood: each meter of axis adds a little area, which makes trunks taper below the
crown too.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from megalopta.assets_gen import FloatArray

IndexArray = NDArray[np.intp]


@dataclass(frozen=True)
class Skeleton:
    """Nodes, and the node from which each grew."""

    positions: FloatArray
    """(n, 3): meters, z up."""
    parents: IndexArray
    """(n,): index of the parent, always smaller than the node's own; −1 for a root."""

    def child_counts(self) -> IndexArray:
        """Return the number of nodes that grew from each node, shape (n,)."""
        return np.bincount(self.parents[self.parents >= 0], minlength=len(self.parents))

    def internodes(self) -> FloatArray:
        """Return the vector from parent to node, shape (n, 3), zero at roots (m)."""
        vectors = self.positions - self.positions[self.parents]
        vectors[self.parents < 0] = 0
        return vectors

    def extended(self, positions: FloatArray, parents: IndexArray) -> "Skeleton":
        """Return the skeleton with nodes appended."""
        return Skeleton(
            np.concatenate([self.positions, positions]), np.concatenate([self.parents, parents])
        )

    def with_chain(self, positions: FloatArray) -> "Skeleton":
        """Return the skeleton with one more root and the nodes (n, 3) of a chain from it."""
        parents = len(self.positions) + np.arange(-1, len(positions) - 1)
        parents[0] = -1
        return self.extended(positions, parents)


def sum_toward_root(skeleton: Skeleton, values: FloatArray) -> FloatArray:
    """Return for every node the sum of `values` (n,) over itself and all nodes grown from it."""
    totals = values.astype(float)
    for node in range(len(totals) - 1, 0, -1):
        parent = skeleton.parents[node]
        if parent >= 0:
            totals[parent] += totals[node]
    return totals


def pipe_areas(skeleton: Skeleton, disused_share: float) -> FloatArray:
    """Return the cross-section of every node in pipes of one living tip, shape (n,).

    It is the number of tips above the node plus `disused_share` (1/m), for pipes of shed leaves,
    times the length of axis above it.
    """
    tips = (skeleton.child_counts() == 0).astype(float)
    disused: FloatArray = disused_share * np.linalg.norm(skeleton.internodes(), axis=1)
    return sum_toward_root(skeleton, tips + disused) - disused


def pipe_radii(
    skeleton: Skeleton, disused_share: float, radius_m: float, at_height_m: float
) -> FloatArray:
    """Return the radius of every node (m); the stem's is `radius_m` at `at_height_m`.

    The stem is the first root's thickest axis.
    """
    areas = pipe_areas(skeleton, disused_share)
    stem = axes(skeleton, areas)[0]
    reference = np.interp(at_height_m, skeleton.positions[stem, 2], areas[stem])
    return radius_m * np.sqrt(areas / reference)


def axes(skeleton: Skeleton, thickness: FloatArray) -> list[IndexArray]:
    """Return the axes: node indices from base to tip, each continued by the thickest child.

    A side axis starts at the node that bears it. Every internode belongs to exactly one axis.
    """
    heir = np.full(len(thickness), -1)
    for node, parent in enumerate(skeleton.parents):
        if parent >= 0 and (heir[parent] < 0 or thickness[node] > thickness[heir[parent]]):
            heir[parent] = node
    starts = [n for n, p in enumerate(skeleton.parents) if p < 0 or heir[p] != n]
    return [_follow(heir, int(skeleton.parents[start]), start) for start in starts]


def _follow(heir: IndexArray, bearer: int, start: int) -> IndexArray:
    nodes = [start] if bearer < 0 else [bearer, start]
    while heir[nodes[-1]] >= 0:
        nodes.append(int(heir[nodes[-1]]))
    return np.array(nodes)


def relaxed(skeleton: Skeleton, passes: int) -> Skeleton:
    """Return the skeleton with kinks relaxed; forks follow their thicker branch, tips stay."""
    counts = skeleton.child_counts()
    inner = (skeleton.parents >= 0) & (counts > 0)
    weight = sum_toward_root(skeleton, np.where(counts == 0, 1.0, 0.0))[:, None] ** 2
    total = _sum_over_children(skeleton.parents, weight)[inner]
    positions = skeleton.positions
    for _ in range(passes):
        ahead = _sum_over_children(skeleton.parents, weight * positions)[inner] / total
        middle = (positions[skeleton.parents[inner]] + ahead) / 2
        positions = positions.copy()
        positions[inner] = (positions[inner] + middle) / 2
    return Skeleton(positions, skeleton.parents)


def _sum_over_children(parents: IndexArray, values: FloatArray) -> FloatArray:
    total = np.zeros_like(values)
    np.add.at(total, parents[parents >= 0], values[parents >= 0])
    return total
