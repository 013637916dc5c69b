"""Faults of the readout: how they are told, codes of the ADC, and the order of the pixels.

A comb of counts is smoother than one code only if read noise exceeds half a code; therefore the
expected recording, with the same comb, must not show the same faults of codes.

The fixed pattern of a device is its fingerprint. Spearman's rank correlation of two maps is
insensitive to gain, offset and hot pixels. Of the 8 symmetries of the square, one with a clearly
higher correlation is named, and undone. Otherwise rows, or columns, are assigned to those most like
them. Each cycle of this order, such as two swapped lines, is judged by its own lines: in a large
array they hardly change the correlation of the whole.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.stats import rankdata

from megalopta.core.arrays import Floats, Mask

_MOST_LISTED = 8
_FREQUENT = 100


class Fault(NamedTuple):
    """A fault that was found before any parameter of the device was fitted."""

    kind: str
    """Name, for example "dead row"."""
    text: str
    """Phrase with place and size."""

    def __str__(self) -> str:
        return self.text


def listed(places: Iterable[object]) -> str:
    """Return places as text; of many, the first ones and their number."""
    texts = [str(place) for place in places]
    more = f" and {len(texts) - _MOST_LISTED} more" if len(texts) > _MOST_LISTED else ""
    return ", ".join(texts[:_MOST_LISTED]) + more


def pixels_of(mask: Mask) -> str:
    """Return the places (row, column) of marked pixels as text."""
    places = [f"({row}, {column})" for row, column in np.argwhere(mask)]
    return f"{'pixel' if len(places) == 1 else 'pixels'} {listed(places)}"


def stuck_bits(histograms: Floats) -> dict[int, bool]:
    """Find the values of bits that never change in captured codes, by `code_histograms`."""
    codes, stuck = np.arange(histograms.shape[1]), {}
    for bit in range(int(codes[-1]).bit_length()):
        is_one = (codes >> bit) & 1 == 1
        share, usual = histograms[:, is_one].sum(axis=1) / histograms.sum(axis=1)
        # otherwise both values of the bit are expected
        if share in (0.0, 1.0) and abs(usual - share) > 0.01:
            stuck[bit] = bool(share == 1.0)
    return stuck


def uneven_codes(histograms: Floats) -> list[Fault]:
    """Find missing or uneven codes, by `code_histograms`."""
    middle, least = histograms[:, 1:-1], np.minimum(histograms[:, :-2], histograms[:, 2:])
    missing = (least[0] > _FREQUENT) & (middle[0] < 0.05 * least[0])
    missing &= middle[1] > 0.3 * least[1]
    if missing.any():
        text = f"the ADC lacks codes: {listed(np.flatnonzero(missing) + 1)}"
        return [Fault("missing codes", text)]
    (excess, error), (usual, usual_error) = map(_parity, histograms)
    share, error = excess - usual, float(np.hypot(error, usual_error))
    if abs(share) <= max(8.0 * error, 0.05):
        return []
    which = "even" if share > 0 else "odd"
    text = f"{which} codes of the ADC are {100 * abs(share):.2g} % wider than others"
    return [Fault("uneven codes", text)]


def code_histograms(*recordings: Sequence[NDArray[Any]]) -> Floats:
    """Return the number of each code in captured and in expected recordings, (2, codes)."""
    size = max(int(codes.max(initial=0)) for levels in recordings for codes in levels) + 1
    counts = [
        sum(np.bincount(codes.ravel(), minlength=size) for codes in levels) for levels in recordings
    ]
    return np.array(counts, np.float64)


def _parity(histogram: Floats) -> tuple[float, float]:
    """Mean relative excess of even codes over their neighbors, and its standard error."""
    left, middle, right = histogram[:-2], histogram[1:-1], histogram[2:]
    used = (np.minimum(left, right) > _FREQUENT) & (middle > _FREQUENT)
    if used.sum() < 32:
        return 0.0, np.inf
    even = np.where(np.arange(1, histogram.size - 1) % 2 == 0, 1.0, -1.0)[used]
    excess = even * np.log(middle[used] / ((left + right) / 2)[used])
    return float(excess.mean()), float(excess.std(ddof=1) / np.sqrt(excess.size))


_AS_EXPECTED = "neither turned nor mirrored"
_SYMMETRIES = (
    (_AS_EXPECTED, False, 0),
    ("turned by 90° to the right", False, 1),
    ("turned by 180°", False, 2),
    ("turned by 90° to the left", False, 3),
    ("transposed", True, 0),
    ("mirrored, its rows in reverse order", True, 1),
    ("transposed about the other diagonal", True, 2),
    ("mirrored, its columns in reverse order", True, 3),
)
"""Name, whether rows and columns are exchanged, and turns by 90° that undo it"""


class Arrangement(NamedTuple):
    """Rearrangement under which a map resembles another one."""

    name: str
    correlation: float
    """Rank correlation after rearranging."""
    as_it_is: float
    """Rank correlation before rearranging."""
    undone: Callable[[NDArray[Any]], NDArray[Any]]
    """Returns captured frames (n, rows, columns) in the expected order."""

    @property
    def is_other(self) -> bool:
        """True if anything is swapped."""
        return self.name != _AS_EXPECTED

    def __str__(self) -> str:
        return (
            f"the image is {self.name} (rank correlation rearranged {self.correlation:.2f}, before "
            f"{self.as_it_is:.2f})"
        )


def _turned(frames: NDArray[Any], is_transposed: bool, turns: int) -> NDArray[Any]:
    frames = frames.swapaxes(1, 2) if is_transposed else frames
    return np.rot90(frames, turns, axes=(1, 2))


def arrangement(captured: Floats, expected: Floats) -> Arrangement:
    """Find the rearrangement of a map (rows, columns) relative to the expected one."""
    plain = _correlation(captured, expected)
    best = Arrangement(_AS_EXPECTED, plain, plain, lambda frames: frames)
    for name, is_transposed, turns in _SYMMETRIES:
        turned = partial(_turned, is_transposed=is_transposed, turns=turns)
        candidate = turned(captured[np.newaxis])[0]
        if candidate.shape == expected.shape:
            correlation = _correlation(candidate, expected)
            # Fisher's z test; a map of 256 pixels has a standard error of 0.09
            z = np.arctanh(np.clip([correlation, best.correlation], -0.999999, 0.999999))
            if (z[0] - z[1]) * np.sqrt((captured.size - 3) / 2) > 6.0:
                best = Arrangement(name, correlation, plain, turned)
    if best.is_other:
        return best
    for lines, axis, maps in (
        ("rows", 1, (captured, expected)),
        ("columns", 2, (captured.T, expected.T)),
    ):
        order = _order(*maps)
        if moved := int((order != np.arange(len(order))).sum()):
            name = f"{moved} of {len(order)} {lines} in another order"
            correlation = _correlation(maps[0][order], maps[1])
            return Arrangement(name, correlation, plain, partial(np.take, indices=order, axis=axis))
    return best


def _order(captured: Floats, expected: Floats) -> NDArray[np.intp]:
    """Captured row at the place of each expected one, (rows,): as it is where that is no chance."""
    units = []
    for values in (expected, captured):
        ranks = rankdata(values).reshape(values.shape)
        ranks = ranks - ranks.mean(axis=1, keepdims=True)
        size = np.sqrt((ranks**2).sum(axis=1, keepdims=True))
        units.append(ranks / np.where(size > 0, size, 1))
    alike = np.arctanh(np.clip(units[0] @ units[1].T, -0.999, 0.999))
    assigned = np.asarray(linear_sum_assignment(-alike)[1])
    number = len(assigned)
    order, left = np.arange(number), set(range(number))
    while left:
        cycle = [left.pop()]
        while (following := int(assigned[cycle[-1]])) in left:
            left.remove(following)
            cycle.append(following)
        size = len(cycle)
        gain = float((alike[cycle, assigned[cycle]] - alike[cycle, cycle]).sum())
        z = gain * np.sqrt(max(captured.shape[1] - 3, 1) / (2 * size))
        # the best of so many cycles of this size, by chance once in a million maps
        if size > 1 and z**2 / 2 > size * np.log(number) - np.log(size) - np.log(1e-6):
            order[cycle] = assigned[cycle]
    return order


def _correlation(first: Floats, second: Floats) -> float:
    ranks = [rankdata(values) - (values.size + 1) / 2 for values in (first, second)]
    norm = np.sqrt((ranks[0] ** 2).sum() * (ranks[1] ** 2).sum())
    return float((ranks[0] * ranks[1]).sum() / norm) if norm > 0 else 0.0
