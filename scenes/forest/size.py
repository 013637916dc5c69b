"""How large a forest will be, foreseen from its settings: a guard against absurd ones."""

from typing import TYPE_CHECKING

import numpy as np

from megalopta.scenes.forest.floor import fineness
from megalopta.scenes.forest.flora import TREES
from megalopta.scenes.forest.ground import HORIZON_M
from megalopta.scenes.forest.planting import BELT_M, THICKET_PER_M2
from megalopta.scenes.forest.stand import LODS
from megalopta.scenes.forest.undergrowth import LAYERS

if TYPE_CHECKING:
    from megalopta.scenes.forest.description import Forest

SMALL_TRIANGLES = 80
"""Of an average plant of the undergrowth, roughly."""
CARVED_TRIANGLES = 20_000
"""Of the furrows of a stem, roughly."""
TREE_LEAF_M2, LEAF_M2 = 45.0, 0.004
"""Leaves of a tree where no leaf-area index is asked for, and one leaf, roughly (m²)."""
CROWN_M = 5.0
"""Height of the lowest leaves above the camera, roughly (m)."""
CLUMPED = 0.5
"""Share of the undergrowth that is left between its gaps."""
MOST_TRIANGLES = 40e6
"""Larger scenes do not fit into the memory of an ordinary machine (some 300 bytes each)."""


def check_size(forest: "Forest", path_m: float) -> None:
    """Refuse a forest around a path of the given length that would not fit into memory."""
    plants, triangles = foreseen(forest, path_m)
    if triangles > MOST_TRIANGLES:
        raise ValueError(
            f"trees {forest.trees}, density_per_ha {forest.density_per_ha:g}, undergrowth "
            f"{forest.undergrowth:g} and detail {forest.detail:g} make about {plants:.2g} plants "
            f"of {triangles:.2g} triangles, more than {MOST_TRIANGLES:.2g}; lower one of them"
        )


def foreseen(forest: "Forest", path_m: float) -> tuple[float, float]:
    """Return how many plants and triangles there will be around a straight path, roughly."""

    def area(reach: float) -> float:
        return float(np.pi * reach**2 + 2 * reach * path_m)

    per_m2, clearance_m = forest.density_per_ha / 1e4, forest.clearance_m
    # The stand reaches to the R where area(R) − area(clearance) holds its trees.
    half = path_m / np.pi
    edge = float(np.sqrt(half**2 + (forest.trees / per_m2 + area(clearance_m)) / np.pi) - half)
    end = edge + BELT_M
    begins = np.maximum(
        0, forest.detail**2 * np.array([o.beyond_m for o in LODS]) ** 2 - CROWN_M**2
    )
    limits = [*np.minimum(np.sqrt(begins), end).tolist(), end]
    planted = [area(far) - area(clearance_m) if far > clearance_m else 0.0 for far in limits]
    counts = per_m2 * np.diff(planted)
    leaf_m2 = (forest.leaf_area_index or TREE_LEAF_M2 * per_m2) / per_m2
    merged = np.array([max(level.detail.leaf_m2, LEAF_M2) for level in LODS])
    leaves = leaf_m2 / merged * np.where(np.arange(len(LODS)) > 0, 1, 2)
    triangles = np.array([level.wood_triangles for level in LODS]) + leaves
    bushes = THICKET_PER_M2 * (area(end) - area(edge - 7))
    bush = triangles[np.searchsorted(limits[1:-1], edge)] / 8
    small = CLUMPED * sum(
        density * area(min(LAYERS[kind].reach_m, edge))
        for kind, density in forest.densities_per_m2.items()
    )
    total = counts @ triangles + bushes * bush + small * SMALL_TRIANGLES
    if forest.has_floor:
        total += fineness(forest.detail).triangles(path_m, edge + HORIZON_M)
    if forest.bark_relief:
        rough = sum(share for name, share in forest.mix.items() if TREES[name].shape.relief)
        total += counts[0] * CARVED_TRIANGLES * rough / sum(forest.mix.values())
    return float(counts.sum() + bushes + small), float(total)
