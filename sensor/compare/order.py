"""Order in which an image was read out: turned, mirrored, or with its rows swapped.

The pattern of a device is its fingerprint. Spearman's rank correlation of two maps says whether a
pixel that is bright in one is bright in the other; it does not mind gain, offset and hot pixels. Of
the 8 symmetries of the square, and the order of rows that matches best (assignment of rows by their
correlation), the one is named under which it is clearly highest.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist
from scipy.stats import rankdata

from megalopta.core.arrays import Floats

_CLEARLY = 6.0
_SYMMETRIES = {
    "as it is": (False, 0),
    "turned by 90° to the right": (False, 1),
    "turned by 180°": (False, 2),
    "turned by 90° to the left": (False, 3),
    "transposed": (True, 0),
    "mirrored, its rows in reverse order": (True, 1),
    "transposed about the other diagonal": (True, 2),
    "mirrored, its columns in reverse order": (True, 3),
}


class Arrangement(NamedTuple):
    """Rearrangement by which a map is like another one."""

    name: str
    correlation: float
    """Rank correlation when rearranged."""
    as_it_is: float
    """Rank correlation before."""
    rows: tuple[int, ...] | None = None
    """Row of the captured map that stands in each place, where rows are swapped."""

    @property
    def is_other(self) -> bool:
        """True where anything is swapped."""
        return self.name != "as it is"


def arrangement(captured: Floats, expected: Floats) -> Arrangement:
    """Find how a map (rows, columns) is arranged, compared with the expected one."""
    plain = _correlation(captured, expected)
    best = Arrangement("as it is", plain, plain)
    for name, (is_transposed, turns) in _SYMMETRIES.items():
        turned = np.rot90(captured.T if is_transposed else captured, turns)
        if turned.shape == expected.shape:
            found = _correlation(turned, expected)
            if _is_clearly_higher(found, best.correlation, captured.size):
                best = Arrangement(name, found, plain)
    rows = matching_rows(captured, expected)
    swapped = _correlation(captured[rows], expected)
    moved = int((rows != np.arange(len(rows))).sum())
    # among so many orders, one fits by chance: the best of n normal correlations of two rows
    by_chance = float(np.sqrt(2 * np.log(len(rows)) / max(captured.shape[1] - 1, 1)))
    if (
        moved
        and swapped > by_chance
        and _is_clearly_higher(swapped, best.correlation, captured.size)
    ):
        name = f"{moved} of {len(rows)} rows in another order"
        return Arrangement(name, swapped, plain, tuple(int(row) for row in rows))
    return best


def matching_rows(captured: Floats, expected: Floats) -> NDArray[np.intp]:
    """Return the captured row (rows,) that is most like each expected one, each used once."""
    ranks = [rankdata(each).reshape(each.shape) for each in (captured, expected)]
    apart = cdist(ranks[1], ranks[0], "sqeuclidean")
    return np.asarray(linear_sum_assignment(apart)[1])


def _correlation(one: Floats, other: Floats) -> float:
    ranks = [rankdata(each) - (each.size + 1) / 2 for each in (one, other)]
    norm = np.sqrt((ranks[0] ** 2).sum() * (ranks[1] ** 2).sum())
    return float((ranks[0] * ranks[1]).sum() / norm) if norm > 0 else 0.0


def _is_clearly_higher(one: float, other: float, pixels: int) -> bool:
    """Fisher's z; the pixels of a map of 256 make a standard error of 0.09."""
    z = np.arctanh(np.clip([one, other], -0.999999, 0.999999))
    return bool((z[0] - z[1]) * np.sqrt((pixels - 3) / 2) > _CLEARLY)
