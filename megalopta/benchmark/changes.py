"""Where the order of two methods is another one for other blocks, beyond chance.

For two groups, such as rotation alone and high parallax, two methods change places where one is
better in the first and the other in the second. The p-value of that is the larger one of the two
groups' (both must hold). Of all pairs of methods, numbers of photons and pairs of groups those are
told that the rule of Benjamini and Hochberg (1995) leaves: of what is told, a twentieth is expected
to be chance.
"""

from itertools import combinations
from typing import NamedTuple

import numpy as np

from megalopta.benchmark.ranking_record import Order, Ranking
from megalopta.benchmark.sequence_truth import Opposed, opposed
from megalopta.core.arrays import Floats

_FALSE_SHARE = 0.05


class Change(NamedTuple):
    """Two methods that change places."""

    groups: Opposed
    first: Order
    second: Order
    """Of the same methods, the other way round"""
    p: float


def changes(ranking: Ranking) -> list[Change]:
    """Return the changes of order that the data bear, the surest first."""
    cases = []
    for groups in opposed(ranking.blocks):
        for flux in ranking.settings.fluxes:
            for pair in combinations(ranking.settings.methods, 2):
                first, second = (ranking.order_of(flux, name, *pair) for name in groups[:2])
                if first and second:
                    turned = first.better != second.better
                    p = max(first.p, second.p) if turned else 1.0
                    cases.append(Change(groups, first, second, p))
    bound = _bound(np.array([each.p for each in cases]))
    return sorted((each for each in cases if each.p <= bound), key=lambda each: each.p)


def _bound(values: Floats) -> float:
    """Largest p-value that Benjamini and Hochberg accept, −1 where they accept none."""
    ordered = np.sort(values)
    accepted = ordered <= _FALSE_SHARE * np.arange(1, len(ordered) + 1) / max(1, len(ordered))
    return float(ordered[accepted].max()) if accepted.any() else -1.0
