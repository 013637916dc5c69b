"""Faults of the readout: how they are known, codes of the ADC, and the order of the pixels.

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

from megalopta.core.arrays import Floats, Ints, Mask

_MOST_LISTED = 8
_FREQUENT = 100
_SURE = -35.0
"""Logarithm of the chance that a bit never changes"""


_Way = Callable[[NDArray[Any]], NDArray[Any]]
"""What a readout does to readings"""


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


class Bits(NamedTuple):
    """Values of bits that never change in captured readings but would, (rows, columns) each."""

    ones: Ints
    zeros: Ints

    @classmethod
    def of(cls, captured: Sequence[NDArray[Any]], expected: Sequence[NDArray[Any]]) -> "Bits":
        """Find them in the readings (n, rows, columns) of all levels."""
        top = max(int(readings.max(initial=0)) for readings in (*captured, *expected))
        ones, zeros = np.zeros((2, *captured[0].shape[1:]), np.int64)
        in_range = np.zeros(ones.shape, np.bool_)
        for bit in range(top.bit_length()):
            shares = [
                [((readings >> bit) & 1).mean(axis=0) for readings in levels]
                for levels in (captured, expected)
            ]
            for value, stuck in enumerate((zeros, ones)):
                always = np.logical_and.reduce([share == value for share in shares[0]])
                log = np.zeros(stuck.shape)
                for seen, usual, share in zip(captured, expected, shares[1], strict=True):
                    number = len(usual) * (share if value else 1 - share)
                    log += len(seen) * np.log((number + 0.5) / (len(usual) + 1))
                # otherwise both values of the bit are expected
                never_changes = always & (log < _SURE)
                stuck[never_changes] |= 1 << bit
                if never_changes.any():
                    higher = [np.ptp(readings >> bit + 1, axis=0) > 0 for readings in captured]
                    in_range |= never_changes & np.logical_or.reduce(higher)
        # if no higher bit changes, the readings may be others, not their bits
        after = [cls(ones, zeros).put(readings) for readings in expected]
        levels = captured, expected, after
        seen, usual, put = (np.array([part.mean(axis=0) for part in side]) for side in levels)
        is_better = np.abs(seen - put).sum(axis=0) < 0.3 * np.abs(seen - usual).sum(axis=0)
        is_better |= in_range
        pixels = is_better & ((ones | zeros) > 0)
        if pixels.any():
            for of_level in zip(*levels, strict=True):
                seen, usual, put = (readings[:, pixels].ravel() for readings in of_level)
                is_chance = 3 / np.sqrt(min(seen.size, usual.size))
                is_better &= _distance(seen, put) < max(0.3 * _distance(seen, usual), is_chance)
        return cls(np.where(is_better, ones, 0), np.where(is_better, zeros, 0))

    def put(self, readings: NDArray[Any]) -> NDArray[Any]:
        """Put the stuck bits into readings (n, rows, columns)."""
        return (readings | self.ones) & ~self.zeros

    def faults(self, good: Mask) -> list[Fault]:
        """Say which bits are stuck where."""
        found = []
        for bits, value in ((self.ones, 1), (self.zeros, 0)):
            for bit in range(int(bits.max(initial=0)).bit_length()):
                stuck = (bits >> bit) & 1 == 1
                if not (stuck & good).any():
                    continue
                where = pixels_of(stuck)
                for name, axis in (("column", 0), ("row", 1)):
                    lines = np.flatnonzero(stuck.mean(axis=axis) > 0.7)
                    plural = name + "s" * (lines.size > 1)
                    where = f"{plural} {listed(lines)}" if lines.size else where
                where = "all pixels" if stuck[good].mean() > 0.9 else where
                found.append(Fault("stuck bit", f"bit {bit} of {where} is stuck at {value}"))
        return found


def range_of(
    captured: Sequence[NDArray[Any]], expected: Sequence[NDArray[Any]], good: Mask
) -> list[tuple[Fault, _Way]]:
    """Find clipped or wrapped readings, and missing low bits, and what does the same.

    From the readings (n, rows, columns) of all levels.
    """
    seen, usual = (
        np.concatenate([readings[:, good].ravel() for readings in levels])
        for levels in (captured, expected)
    )
    found: list[tuple[Fault, _Way]] = []
    if seen.size == 0 or np.ptp(usual) < 2:
        return found
    top, bottom, before = int(seen.max()), int(seen.min()), _distance(seen, usual)

    def is_clipped(end: int, beyond: float) -> bool:
        usual_at_end = float((usual == end).mean())
        return beyond > 1e-3 and float((seen == end).mean()) > max(0.5 * beyond, 3 * usual_at_end)

    above, below = float((usual > top).mean()), float((usual < bottom).mean())
    ways: list[tuple[str, _Way]] = []
    if above > 1e-3 and (top + 1) & top == 0:
        ways.append((f"wrap at {top + 1}", lambda readings: readings % (top + 1)))
    if is_clipped(top, above):
        ways.append((f"are clipped at {top}", lambda readings: np.minimum(readings, top)))
    if is_clipped(bottom, below):
        ways.append((f"are clipped at {bottom}", lambda readings: np.maximum(readings, bottom)))
    # what is only shifted has its end elsewhere, too
    least = max(0.3 * before, 0.01)
    ways = [(text, way) for text, way in ways if _distance(seen, way(usual)) < least]
    for text, way in sorted(ways, key=lambda way: _distance(seen, way[1](usual)))[:1]:
        found.append((Fault("capacity", f"readings {text}"), way))
        usual = way(usual)
    inside = seen[(seen < top) & (seen > bottom)].astype(np.int64)
    if inside.size < 100:
        return found
    first = int(inside.min())
    step = int(np.gcd.reduce(np.unique(inside - first)))
    codes = np.unique(usual).astype(np.int64)
    if step <= int(np.gcd.reduce(codes - codes[0])):
        return found
    rest = first % step
    # rounded down, to the nearest, or up
    rounding = [partial(_multiples, step, rest, shift) for shift in (0, step // 2, step - 1)]
    best = min(rounding, key=lambda way: _distance(seen, way(usual)))
    if _distance(seen, best(usual)) < 0.5 * _distance(seen, usual):
        text = f"readings are multiples of {step}" + (f", and {rest}" if rest else "")
        found.append((Fault("lost bits", text), best))
    return found


def _multiples(step: int, rest: int, shift: int, readings: NDArray[Any]) -> NDArray[Any]:
    return (readings.astype(np.int64) - rest + shift) // step * step + rest


def _distance(seen: NDArray[Any], usual: NDArray[Any]) -> float:
    """Largest distance of two distributions of readings (Kolmogorov's)."""
    top = int(max(seen.max(), usual.max())) + 1
    first, second = (
        np.cumsum(np.bincount(np.asarray(values, np.int64).clip(0), minlength=top)) / values.size
        for values in (seen, usual)
    )
    return float(np.abs(first - second).max())


def copied_lines(
    captured: NDArray[Any], expected: NDArray[Any], good: Mask
) -> tuple[Mask, list[Fault]]:
    """Find rows and columns that repeat another of the same frame (n, rows, columns)."""
    masked, faults = np.zeros(good.shape, np.bool_), []
    for name, axis in (("row", 1), ("column", 2)):
        lines, usual = (
            np.moveaxis(np.asarray(readings), axis, 0).reshape(readings.shape[axis], -1)
            for readings in (captured, expected)
        )
        z = lines.astype(np.float32).reshape(len(lines), len(captured), -1)
        z = (z - z.mean(axis=1, keepdims=True)).reshape(len(lines), -1)
        size = np.sqrt(np.square(z).sum(axis=1)).clip(1e-12)
        alike = np.tril(z @ z.T / size / size[:, None], -1)
        pairs = []
        for second, first in np.argwhere(alike > 0.3):
            same, chance = (float((part[first] == part[second]).mean()) for part in (lines, usual))
            if same > chance + 0.4 * (1 - chance):
                pairs.append((int(first), int(second)))
        if pairs:
            text = f"{name}s {listed(f'{a} and {b}' for a, b in pairs)} have the same readings"
            faults.append(Fault(f"copied {name}s", text))
            # the copy is the one that is not as expected
            off = np.abs(lines.mean(axis=1) - usual.mean(axis=1))
            copies = sorted({max(pair, key=lambda number: off[number]) for pair in pairs})
            masked[(copies,) if axis == 1 else (slice(None), copies)] = True
    return masked, faults


def uneven_codes(captured: Sequence[NDArray[Any]], expected: Sequence[NDArray[Any]]) -> list[Fault]:
    """Find missing or uneven codes, from the readings of all levels."""
    size = max(int(codes.max(initial=0)) for codes in (*captured, *expected)) + 1
    seen, usual = (
        np.sum([np.bincount(codes.ravel(), minlength=size) for codes in levels], axis=0) * 1.0
        for levels in (captured, expected)
    )
    beside, usually_beside = (np.minimum(codes[:-2], codes[2:]) for codes in (seen, usual))
    missing = (beside > _FREQUENT) & (seen[1:-1] < 0.05 * beside)
    missing &= usual[1:-1] > 0.3 * usually_beside
    # many that are missing are those of a gain
    if 0 < missing.sum() < 0.08 * max((usually_beside > _FREQUENT).sum(), 13):
        text = f"the ADC lacks codes: {listed(np.flatnonzero(missing) + 1)}"
        return [Fault("missing codes", text)]
    (excess, error), (usual_excess, usual_error) = _parity(seen), _parity(usual)
    share = excess - usual_excess
    if abs(share) <= max(8.0 * float(np.hypot(error, usual_error)), 0.05):
        return []
    which = "even" if share > 0 else "odd"
    text = f"{which} codes of the ADC are {100 * abs(share):.2g} % wider than others"
    return [Fault("uneven codes", text)]


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
    (_AS_EXPECTED, (0, 1, 2), 0),
    ("turned by 90° to the right", (0, 1, 2), 1),
    ("turned by 180°", (0, 1, 2), 2),
    ("turned by 90° to the left", (0, 1, 2), 3),
    ("transposed", (0, 2, 1), 0),
    ("mirrored, its rows in reverse order", (0, 2, 1), 1),
    ("transposed about the other diagonal", (0, 2, 1), 2),
    ("mirrored, its columns in reverse order", (0, 2, 1), 3),
)
"""Name, order of axes, and turns by 90° that undo it"""


class Arrangement(NamedTuple):
    """Rearrangement under which a map resembles another one."""

    name: str
    correlation: float
    """Rank correlation after rearranging."""
    as_it_is: float
    """Rank correlation before rearranging."""
    undone: _Way
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


def arrangement(captured: Floats, expected: Floats) -> Arrangement:
    """Find the rearrangement of a map (rows, columns) relative to the expected one."""
    plain = _correlation(captured, expected)
    best = Arrangement(_AS_EXPECTED, plain, plain, lambda frames: frames)
    for name, axes, turns in _SYMMETRIES:
        turned = partial(_turned, axes=axes, turns=turns)
        candidate = turned(captured[np.newaxis])[0]
        if candidate.shape == expected.shape:
            correlation = _correlation(candidate, expected)
            # Fisher's z test; a map of 256 pixels has a standard error of 0.09
            z = np.arctanh(np.clip([correlation, best.correlation], -0.999999, 0.999999))
            if (z[0] - z[1]) * np.sqrt((captured.size - 3) / 2) > 6.0:
                best = Arrangement(name, correlation, plain, turned)
    for axis, lines in enumerate(("rows", "columns")) if not best.is_other else ():
        seen, usual = np.moveaxis(captured, axis, 0), np.moveaxis(expected, axis, 0)
        order = _order(seen, usual)
        if moved := int((order != np.arange(len(order))).sum()):
            name = f"{moved} of {len(order)} {lines} in another order"
            undone = partial(np.take, indices=order, axis=axis + 1)
            return Arrangement(name, _correlation(seen[order], usual), plain, undone)
    return best


def _turned(frames: NDArray[Any], axes: tuple[int, ...], turns: int) -> NDArray[Any]:
    return np.rot90(frames.transpose(axes), turns, axes=(1, 2))


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
