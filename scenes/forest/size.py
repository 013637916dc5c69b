"""How large a forest will be, foreseen from its settings: a guard against absurd ones."""

from collections.abc import Mapping

import numpy as np

from megalopta.scenes.forest.planting import BELT_M, THICKET_PER_M2
from megalopta.scenes.forest.stand import LODS
from megalopta.scenes.forest.undergrowth import LAYERS

SMALL_TRIANGLES = 100
"""Of an average plant of the undergrowth, roughly."""
CLUMPED = 0.5
"""Share of the undergrowth that is left between its gaps."""
MOST_TRIANGLES = 40e6
"""Larger scenes do not fit into the memory of an ordinary machine (some 300 bytes each)."""


def foreseen_size(
    trees: int,
    density_per_ha: float,
    clearance_m: float,
    undergrowth_per_m2: Mapping[str, float],
    detail: float,
    path_m: float,
) -> tuple[float, float]:
    """Return how many plants and triangles there will be around a straight path, roughly.

    Parameters
    ----------
    trees, density_per_ha, clearance_m, undergrowth_per_m2, detail
        As in `Forest`, with the common factor on the undergrowth applied.
    path_m : float
        Length of the path (m).
    """

    def area(reach: float) -> float:
        return float(np.pi * reach**2 + 2 * reach * path_m)

    per_m2 = density_per_ha / 1e4
    # The stand reaches to the R where area(R) − area(clearance) holds its trees.
    half = path_m / np.pi
    edge = float(np.sqrt(half**2 + (trees / per_m2 + area(clearance_m)) / np.pi) - half)
    end = edge + BELT_M
    limits = [min(level.beyond_m * detail, end) for level in LODS] + [end]
    planted = [area(far) - area(clearance_m) if far > clearance_m else 0.0 for far in limits]
    counts = per_m2 * np.diff(planted)
    triangles = np.array([level.triangles for level in LODS])
    bushes = THICKET_PER_M2 * (area(end) - area(edge - 7))
    bush = triangles[np.searchsorted(limits[1:-1], edge)] / 4
    small = CLUMPED * sum(
        density * area(min(LAYERS[kind].reach_m, edge))
        for kind, density in undergrowth_per_m2.items()
    )
    total = counts @ triangles + bushes * bush + small * SMALL_TRIANGLES
    return float(counts.sum() + bushes + small), float(total)
