"""Order of the pixels: rotated, mirrored, or with rows or columns swapped.

The fixed pattern of a device is its fingerprint. Spearman's rank correlation of two maps measures
whether bright pixels agree; it is insensitive to gain, offset and hot pixels. Of the 8 symmetries
of the square, one with a clearly higher correlation is named, and undone. Otherwise rows, or
columns, are assigned to those most like them. Each cycle of this order, such as two swapped lines,
is judged by its own lines: in a large array they hardly change the correlation of the whole.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.stats import rankdata

from megalopta.core.arrays import Floats

_CLEARLY = 6.0
_CHANCE = 1e-6
_SYMMETRIES = {
    "neither turned nor mirrored": (False, 0),
    "turned by 90° to the right": (False, 1),
    "turned by 180°": (False, 2),
    "turned by 90° to the left": (False, 3),
    "transposed": (True, 0),
    "mirrored, its rows in reverse order": (True, 1),
    "transposed about the other diagonal": (True, 2),
    "mirrored, its columns in reverse order": (True, 3),
}


class Arrangement(NamedTuple):
    """Rearrangement under which a map resembles another one."""

    name: str
    correlation: float
    """Rank correlation after rearranging."""
    as_it_is: float
    """Rank correlation before rearranging."""
    rows: tuple[int, ...] | None = None
    """Row of the captured map at each place, if rows are swapped."""
    columns: tuple[int, ...] | None = None
    """Column at each place, if columns are swapped."""

    @property
    def is_other(self) -> bool:
        """True if anything is swapped."""
        return self.name != "neither turned nor mirrored"

    def undone(self, frames: NDArray[Any]) -> NDArray[Any]:
        """Return captured frames (n, rows, columns) in the expected order."""
        if self.rows is not None:
            return frames[:, list(self.rows)]
        if self.columns is not None:
            return frames[:, :, list(self.columns)]
        is_transposed, turns = _SYMMETRIES[self.name]
        frames = frames.swapaxes(1, 2) if is_transposed else frames
        return np.rot90(frames, turns, axes=(1, 2))

    def __str__(self) -> str:
        """Describe it in a phrase."""
        return (
            f"the image is {self.name} (rank correlation rearranged {self.correlation:.2f}, before "
            f"{self.as_it_is:.2f})"
        )


def arrangement(captured: Floats, expected: Floats) -> Arrangement:
    """Find the rearrangement of a map (rows, columns) relative to the expected one."""
    plain = _correlation(captured, expected)
    best = Arrangement("neither turned nor mirrored", plain, plain)
    for name, (is_transposed, turns) in _SYMMETRIES.items():
        turned = np.rot90(captured.T if is_transposed else captured, turns)
        if turned.shape == expected.shape:
            found = _correlation(turned, expected)
            if _is_clearly_higher(found, best.correlation, captured.size):
                best = Arrangement(name, found, plain)
    for lines in ("rows", "columns") if not best.is_other else ():
        pair = (captured, expected) if lines == "rows" else (captured.T, expected.T)
        order = _order(*pair)
        moved = int((order != np.arange(len(order))).sum())
        if moved:
            swapped = _correlation(pair[0][order], pair[1])
            name = f"{moved} of {len(order)} {lines} in another order"
            places = tuple(int(each) for each in order)
            best = Arrangement(name, swapped, plain, **{lines: places})
            break
    return best


def _order(captured: Floats, expected: Floats) -> NDArray[np.intp]:
    """Captured row at the place of each expected one, (rows,): as it is where that is no chance."""
    alike = np.arctanh(np.clip(_line_correlations(expected, captured), -0.999, 0.999))
    found = np.asarray(linear_sum_assignment(-alike)[1])
    order, number = np.arange(len(found)), len(found)
    for cycle in _cycles(found):
        size = len(cycle)
        gain = float((alike[cycle, found[cycle]] - alike[cycle, cycle]).sum())
        z = gain * np.sqrt(max(captured.shape[1] - 3, 1) / (2 * size))
        # the best of so many cycles of this size, by chance once in a million maps
        if size > 1 and z**2 / 2 > size * np.log(number) - np.log(size) - np.log(_CHANCE):
            order[cycle] = found[cycle]
    return order


def _cycles(order: NDArray[np.intp]) -> list[list[int]]:
    left, found = set(range(len(order))), []
    while left:
        cycle = [left.pop()]
        while (following := int(order[cycle[-1]])) in left:
            left.remove(following)
            cycle.append(following)
        found.append(cycle)
    return found


def _line_correlations(one: Floats, other: Floats) -> Floats:
    """Rank correlations of all rows of one map with all of another, (rows, rows)."""
    units = []
    for each in (one, other):
        ranks = rankdata(each).reshape(each.shape)
        apart = ranks - ranks.mean(axis=1, keepdims=True)
        size = np.sqrt((apart**2).sum(axis=1, keepdims=True))
        units.append(apart / np.where(size > 0, size, 1))
    return np.asarray(units[0] @ units[1].T)


def _correlation(one: Floats, other: Floats) -> float:
    ranks = [rankdata(each) - (each.size + 1) / 2 for each in (one, other)]
    norm = np.sqrt((ranks[0] ** 2).sum() * (ranks[1] ** 2).sum())
    return float((ranks[0] * ranks[1]).sum() / norm) if norm > 0 else 0.0


def _is_clearly_higher(one: float, other: float, pixels: int) -> bool:
    """Fisher's z test; a map of 256 pixels has a standard error of 0.09."""
    z = np.arctanh(np.clip([one, other], -0.999999, 0.999999))
    return bool((z[0] - z[1]) * np.sqrt((pixels - 3) / 2) > _CLEARLY)
