"""Poisson counts, drawn faster than by NumPy.

A Poisson count is the sum of independent ones whose means add up. A mean below 4 is split into a
multiple of 1/16 and a rest. The multiples have alias tables, which turn a random word into a count
by one comparison, to 2⁻⁴⁸: Walker, ACM Trans. Math. Softw. 3, 253 (1977). The rest counts the
arrivals of a process of rate one that continues from draw to draw; without an arrival it costs one
subtraction.

From 4 on, each count takes one normal number, by vector instructions: z becomes the count n with
P(N < n) < Φ(z) ≤ P(N ≤ n), which is exact. n is ⌊y⌋ of an expansion in 1/√m: that of Cornish and
Fisher for the Poisson distribution by Giles, ACM Trans. Math. Softw. 42, 7 (2016), with two more
orders,

    y = m + √m·z + (z² + 2)/6 − z(z² + 2)/(72·√m) + (3z⁴ + 7z² − 16)/(810·m)
        − z(207z⁴ + 548z² − 2684)/(155520·m·√m)
        + (228z⁶ + 675z⁴ − 5189z² − 256)/(408240·m²)

Its truncation error is less than `doubt`. Probabilities are summed only if y is that close to an
integer: in six draws per thousand at a mean of 4, one per thousand at 8 and one per 25,000 at 30.

**Packed bits**, 1 for at least one event of a Poisson number, drawn fast.

16 random bits are compared with p·2¹⁶, with p = 1 − exp(−mean) in single precision. In the two
cases in 65536 where this is undecided, a further uniform number is compared with the rest of the
exact p. Draws are exact to the last bit of p, at a quarter of a random word per pixel.
"""

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Ints
from megalopta.core.compiling import compiled
from megalopta.sensor.sampling.streams import (
    EDGES,
    LANES,
    fill_normals,
    fill_words,
    uniform,
    word_streams,
)

SMALLEST_MEAN = 4.0
_CERTAIN_FROM = 2.0**20
"""Mean above which the truncation error is less than the rounding of y"""
_SMALLEST_TERM = 1e-17

_STEP = 1 / 16
"""Power of two, so that sums are exact. Finer steps: rarer arrivals, larger tables."""
_TAIL = 8.0
"""Extent of a table on each side, in standard deviations and further counts; the rest is less
likely than the rounding of a random word."""
_TAIL_COUNTS = 20

_CHANCE = np.uint64(2**48 - 1)
_ALIAS_BITS, _ALIAS = np.uint64(16), np.uint64(2**16 - 1)
_BLOCK = 1024
"""Pixels drawn together"""
_ONE = np.uint64(1)
_NO_MORE = np.zeros(1)
_NO_MORE.flags.writeable = (
    False  # like dark counts of a device, for which `_draw` is compiled anyway
)
_MOST = int(np.iinfo(np.int64).max)


class _Tables(NamedTuple):
    """Alias tables of the multiples of the step."""

    heads: NDArray[np.uint64]
    """First cell of each table; shift of the leading bits of a word, which choose the cell; count
    of the first cell"""

    cells: NDArray[np.uint64]
    """Probability of a cell's own count in 48 bits, and the cell of the alternative in 16"""


def draw_poisson(rng: np.random.Generator, means: Floats, factor: float = 1.0) -> Ints:
    """Draw one count for each of means·factor, (N,), finite and not negative (not checked)."""
    counts = np.empty(means.size, np.int64)
    fill_poisson(poisson_streams(rng), means, None, factor, counts, _MOST)
    return counts


def fill_poisson(
    streams: NDArray[np.uint64],
    means: Floats,
    more: Floats | None,
    factor: float,
    counts: NDArray[np.integer[Any]],
    most: int,
) -> None:
    """Draw counts of (means + more)·factor into a contiguous (N,) array, none larger than `most`.

    The streams are `poisson_streams`; no count depends on those that follow it.
    """
    rates = means, _NO_MORE if more is None else more, factor
    _draw(streams, *rates, _tables(), EDGES, counts, most)


def poisson_streams(rng: np.random.Generator) -> NDArray[np.uint64]:
    """Draw the initial state of `fill_poisson` from a generator, (3, 4, LANES)."""
    return word_streams(rng, 3)


@cache
def _tables() -> _Tables:
    tables = [_probabilities(mean) for mean in np.arange(0, SMALLEST_MEAN, _STEP)]
    sizes = np.array([chances.size for _, chances in tables])
    starts, shifts = np.cumsum(sizes) - sizes, [65 - int(size).bit_length() for size in sizes]
    return _Tables(
        np.column_stack((starts, shifts, [first for first, _ in tables])).astype(np.uint64),
        np.concatenate([_alias_cells(chances) for _, chances in tables]),
    )


def _probabilities(mean: float) -> tuple[int, Floats]:
    """Smallest count, and the probabilities from there on; their number is a power of two."""
    reach = _TAIL * math.sqrt(mean) + _TAIL_COUNTS
    first, mode = int(max(mean - reach, 0)), int(mean)
    size = 2 ** int(mean + reach - first).bit_length()
    # P(n) is P(n − 1)·mean/n, from the most likely count in both directions
    below = np.cumprod(np.arange(mode, first, -1) / mean)[::-1]
    above = np.cumprod(mean / np.arange(mode + 1, first + size))
    chances = np.concatenate((below, [1.0], above))
    return first, chances / chances.sum()


@compiled
def _alias_cells(chances: Floats) -> NDArray[np.uint64]:
    """Equalize the cells: those with too much probability fill up those with too little."""
    share = chances * chances.size
    cells = np.empty(chances.size, np.uint64)
    poor, rich = list(np.flatnonzero(share < 1)), list(np.flatnonzero(share >= 1))
    while poor and rich:
        cell, alias = poor.pop(), rich[-1]
        chance = np.uint64(share[cell] * 2.0**48)
        cells[cell] = (chance << _ALIAS_BITS) | np.uint64(alias)
        share[alias] -= 1 - share[cell]
        if share[alias] < 1:
            poor.append(rich.pop())
    for cell in poor + rich:  # full, except for rounding
        cells[cell] = (_CHANCE << _ALIAS_BITS) | np.uint64(cell)
    return cells


@compiled
def _draw(
    streams: NDArray[np.uint64],
    means: Floats,
    more: Floats,
    factor: float,
    tables: _Tables,
    edges: Floats,
    counts: NDArray[np.integer[Any]],
    most: int,
) -> None:
    """Draw by block; if means are small and large, all as large, then the small ones again."""
    words = np.empty((2, _BLOCK // LANES, LANES), np.uint64)
    mean, z, drawn = np.empty(_BLOCK), np.empty(_BLOCK), np.empty(_BLOCK)
    small = np.empty(_BLOCK, np.uint64)
    fill_words(streams[0], words[0])
    used, wait = 1, -math.log(uniform(words[0, 0, 0]))  # time to the first arrival
    for start in range(0, means.size, _BLOCK):
        size = min(_BLOCK, means.size - start)
        block = counts[start : start + size]
        if more.size > 1:
            for k in range(size):
                mean[k] = (means[start + k] + more[start + k]) * factor
        else:
            for k in range(size):
                mean[k] = (means[start + k] + more[0]) * factor
        number = _list_small(mean[:size], small)
        if number < size:
            fill_normals(streams[1], streams[2], words[1], edges, z[:size])
            fill_quantiles(z[:size], mean[:size], drawn[:size])
            for k in range(size):
                block[k] = min(int(drawn[k]), most)
        if number:
            places = small[:number]
            used, wait = _draw_small(
                streams[0], words[0], used, wait, tables, mean, places, block, most
            )


@compiled
def _list_small(mean: Floats, places: NDArray[np.uint64]) -> int:
    """List where means are small; return the number."""
    number = np.int64(0)
    for k in range(mean.size):  # counted first, by vector instructions
        number += np.int64(mean[k] < SMALLEST_MEAN)
    if number:
        n = np.int64(0)
        for k in range(mean.size):  # without a branch, which a processor would mispredict
            places[n] = k
            n += np.int64(mean[k] < SMALLEST_MEAN)
    return int(number)


@compiled
def _draw_small(
    streams: NDArray[np.uint64],
    words: NDArray[np.uint64],
    used: int,
    wait: float,
    tables: _Tables,
    means: Floats,
    places: NDArray[np.uint64],
    counts: NDArray[np.integer[Any]],
    most: int,
) -> tuple[int, float]:
    """Draw at places; return the number of used words and the time to the next arrival."""
    word, size = words.reshape(-1), words.size
    for place in places:
        mean = means[place]
        if used + 1 >= size:
            fill_words(streams, words)
            used = 0
        table, count = np.uint64(mean / _STEP), np.uint64(0)
        if table:
            head = tables.heads[table]
            column = word[used] >> head[1]
            cell = tables.cells[head[0] + column]
            # no branch, which a processor would mispredict half of the time
            is_own = np.uint64((word[used] & _CHANCE) < (cell >> _ALIAS_BITS))
            alias = cell & _ALIAS
            count = np.uint64(head[2] + alias + is_own * (column - alias))
            used += 1
        wait -= mean - float(table) * _STEP
        while wait < 0:
            if used == size:
                fill_words(streams, words)
                used = 0
            wait -= math.log(uniform(word[used]))
            used += 1
            count += _ONE
        counts[place] = min(int(np.int64(count)), most)
    return used, wait


@compiled
def fill_quantiles(z: Floats, means: Floats, counts: Floats) -> None:
    """Turn normal numbers (N,) into Poisson counts (N,) of means (N,).

    For means below `SMALLEST_MEAN`, drawn elsewhere, counts are meaningless.
    """
    doubtful = np.int64(0)
    for k in range(z.size):  # branch-free, so that it vectorizes
        mean = max(means[k], SMALLEST_MEAN)
        y = place(z[k], mean)
        is_near = abs(y - np.rint(y)) < doubt(z[k], mean)
        is_doubtful = is_near & (means[k] >= SMALLEST_MEAN) & (mean < _CERTAIN_FROM)
        counts[k] = math.nan if is_doubtful else math.floor(y)
        doubtful += np.int64(is_doubtful)
    if doubtful:
        for k in range(z.size):
            if math.isnan(counts[k]):
                counts[k] = exact_quantile(z[k], means[k])


@compiled
def place(z: float, mean: float) -> float:
    """Return y, whose integer part is the count unless y is close to an integer."""
    sigma, square = math.sqrt(mean), z * z
    inverse = 1 / sigma
    # terms of y/√m, which decrease by √m each
    third = -z * (square + 2) / 72
    fourth = ((3 * square + 7) * square - 16) / 810
    fifth = -z * ((207 * square + 548) * square - 2684) / 155520
    sixth = (((228 * square + 675) * square - 5189) * square - 256) / 408240
    small = (third + inverse * (fourth + inverse * (fifth + inverse * sixth))) * inverse
    return mean + sigma * z + ((square + 2) / 6 + small)


@compiled
def doubt(z: float, mean: float) -> float:
    """Return the distance of y from an integer within which the count is undecided."""
    square = z * z
    return (0.04 + 0.0015 * square * square * square * abs(z)) / (mean * mean * math.sqrt(mean))


@compiled
def exact_quantile(z: float, mean: float) -> float:
    """Return the count of z by summing probabilities of the smaller tail."""
    chance = 0.5 * math.erfc(abs(z) / math.sqrt(2))
    count = max(np.rint(place(z, mean)), 0.0)
    if z < 0:
        count = min(count, np.floor(mean))  # far down, the expansion turns up again
        while _at_most(count, mean) < chance:
            count += 1
        while count > 0 and _at_most(count - 1, mean) >= chance:
            count -= 1
    else:
        while _more_than(count, mean) > chance:
            count += 1
        while count > 0 and _more_than(count - 1, mean) <= chance:
            count -= 1
    return float(count)


@compiled
def _probability(count: float, mean: float) -> float:
    return math.exp(count * math.log(mean) - mean - math.lgamma(count + 1))


@compiled
def _at_most(count: float, mean: float) -> float:
    """P(N ≤ count), for a count not far above the mean."""
    total, term, n = 1.0, 1.0, count
    while n > 0 and term > _SMALLEST_TERM * total:
        term *= n / mean
        total += term
        n -= 1
    return float(total * _probability(count, mean))


@compiled
def _more_than(count: float, mean: float) -> float:
    """P(N > count), for a count not far below the mean."""
    total, term, n = 1.0, 1.0, count + 1
    while term > _SMALLEST_TERM * total:
        n += 1
        term *= mean / n
        total += term
    return float(total * _probability(count + 1, mean))


CHANCE_ERROR = 2e-6
"""Error bound of `chance`; the largest error found is 1.2e-6."""

_LARGEST_MEAN = np.float32(16)

# Minimax polynomial of e^(−y), 0 ≤ y ≤ 1: error 3e-8 in exact arithmetic.
_C = np.polynomial.chebyshev.Chebyshev.interpolate(lambda y: np.exp(-y), 6, [0, 1])
_C0, _C1, _C2, _C3, _C4, _C5, _C6 = map(np.float32, _C.convert(kind=np.polynomial.Polynomial).coef)

# Multiplier that collects eight bytes of 0 or 1 in the highest byte, the first one on top.
_GATHER = np.uint64(0x8040201008040201)

_OPEN = np.uint8(2)
"""Placeholder for an undecided bit."""
_ANY_OPEN = np.uint64(0x0202020202020202)
_LOTS = np.float32(65536)
# Twice the error of p·2¹⁶ in single precision; a draw this far from both ends is decided.
_MARGIN = np.float32(2 * CHANCE_ERROR * 65536)
_CERTAIN = np.float32(1) + _MARGIN

_LANES_AT_ONCE = 128
"""Random words are made 16 kB at a time, to stay in the first-level cache."""


@compiled
def fill_bits(
    streams: NDArray[np.uint64],
    rate_hz: Floats,
    more_hz: Floats,
    open_s: float,
    packed: NDArray[np.uint8],
) -> None:
    """Draw one frame of bits, packed along the width as by `np.packbits`.

    `streams`: `word_streams`; `rate_hz`, `more_hz` (rows, columns): the mean number of events is
    (rate_hz + more_hz)·open_s; `packed` (rows, ceil(columns/8)): output.
    """
    rows, columns = rate_hz.shape
    bits = np.zeros(8 * packed.shape[1], np.uint8)
    eights = bits.view(np.uint64)
    means = np.empty(columns, np.float32)
    lanes = -(-columns // (4 * LANES))
    at_once = max(1, _LANES_AT_ONCE // lanes)
    words = np.empty((at_once * lanes, LANES), np.uint64)
    all_lots = words.reshape(-1).view(np.uint16).reshape(at_once, -1)
    for row in range(rows):
        if row % at_once == 0:
            fill_words(streams, words)
        lots = all_lots[row % at_once]
        # No branches and one array each: these loops become vector instructions, the second one
        # twice as wide, as it has nothing in double precision.
        for column in range(columns):
            means[column] = (rate_hz[row, column] + more_hz[row, column]) * open_s
        for column in range(columns):
            above = _LOTS * chance(means[column]) - np.float32(np.int32(lots[column]))
            bits[column] = _OPEN * (above > -_MARGIN) - (above >= _CERTAIN)
        seen = np.uint64(0)
        for byte in range(eights.size):
            seen |= eights[byte]
        if seen & _ANY_OPEN:
            _settle(streams, rate_hz[row], more_hz[row], open_s, lots, bits)
        for byte in range(eights.size):
            packed[row, byte] = (eights[byte] * _GATHER) >> np.uint64(56)


@compiled
def _settle(
    streams: NDArray[np.uint64],
    rate_hz: Floats,
    more_hz: Floats,
    open_s: float,
    lots: NDArray[np.uint16],
    bits: NDArray[np.uint8],
) -> None:
    """Draw the bits that single precision leaves undecided."""
    words = np.empty((1, LANES), np.uint64)
    for column in range(rate_hz.size):
        if bits[column] == _OPEN:
            mean = (rate_hz[column] + more_hz[column]) * open_s
            fill_words(streams, words)
            uniform = (words[0, 0] >> np.uint64(11)) * 2.0**-53
            bits[column] = uniform < -np.expm1(-mean) * 65536.0 - lots[column]


@compiled(inline="always")
def chance(mean: np.float32) -> np.float32:
    """Probability of at least one of `mean` expected events; error below `CHANCE_ERROR`.

    1 − e^(−m) for m up to 16, 1 beyond: e^(−m/16) by a polynomial of degree 6, squared four times.
    Without branches and tables, a loop over pixels vectorizes in single precision.
    """
    y = min(mean, _LARGEST_MEAN) * np.float32(1 / 16)
    e = _C0 + y * (_C1 + y * (_C2 + y * (_C3 + y * (_C4 + y * (_C5 + y * _C6)))))
    e *= e
    e *= e
    e *= e
    e *= e
    return np.float32(1) - e
