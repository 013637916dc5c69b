"""Poisson counts, drawn faster than NumPy does.

A Poisson count is the sum of independent ones whose means add up. Below 2048 the mean is cut into a
multiple of 16, one of 1/16, and a rest. The multiples have alias tables, which turn a random word
into a count by one comparison, to 2⁻⁴⁸: Walker, ACM Trans. Math. Softw. 3, 253 (1977). The rest is
the number of arrivals of a process of rate one that runs on from draw to draw, so it costs a
subtraction as long as nothing arrives. Whether any mean has a multiple of 1/16 is asked of a frame
and not of each pixel, which in dim light a processor would guess wrong every other time.

From 2048 on, a normal number z becomes the nearest integer n to its quantile of Cornish and Fisher,

    y(z) = m + √m·z + (z² − 1)/6 + (z − z³)/(72·√m)

and is accepted with a chance proportional to √m·P(n)·y′(z)/φ(z), which for |z| < 8 lies between
√m − |z|/2 − 0.3 and √m + 4.6: it need seldom be evaluated. Beyond, where it may be more, a draw
comes once in 10¹⁵.
"""

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from megalopta.sensor.sampling.words import LANES, fill_words, word_streams

_COARSE, _FINE = 16.0, 1 / 16
"""Powers of two: sums are exact. The finer, the rarer an arrival, the larger its table."""
_FINE_PER_COARSE = 8
"""Binary digits of a mean in units of the fine step that are below the coarse one."""
_LARGEST_MEAN = 2048.0
"""Of the tables"""
_COARSE_TABLES = int(_LARGEST_MEAN / _COARSE)
_TAIL = 8.0
"""Standard deviations of a table on each side, and counts beyond them; what is farther out is less
likely than the rounding of a random word."""
_TAIL_COUNTS = 20

_CHANCE = np.uint64(2**48 - 1)
_ALIAS_BITS, _ALIAS = np.uint64(16), np.uint64(2**16 - 1)
_ROWS_OF_WORDS = 64
_NO_MORE = np.zeros(1)
_NO_MORE.flags.writeable = (
    False  # as dark counts of a device are, for which `_draw` is compiled anyway
)
_MOST = int(np.iinfo(np.int64).max)

_LOW, _HIGH = 0.3, 4.6
"""Of the bounds above; 0.2 and 4.52 are found at a mean of 1024, less at larger ones."""


class _Tables(NamedTuple):
    """Alias tables of the multiples of the coarse step, then of the fine one."""

    start: NDArray[np.int64]
    """Of each table, its first cell"""

    shift: NDArray[np.uint64]
    """Of each table, what moves the leading bits of a word, which choose the cell, to its end"""

    first: NDArray[np.int64]
    """Of each table, the count of its first cell"""

    cells: NDArray[np.uint64]
    """Chance of a cell's own count in 48 bits, and the cell that stands for the rest in 16"""


def draw_poisson(
    rng: np.random.Generator,
    means: NDArray[np.float64],
    more: NDArray[np.float64] | None = None,
    factor: float = 1.0,
) -> NDArray[np.int64]:
    """Draw one count for each of (means + more)·factor, in one pass.

    Parameters
    ----------
    rng : numpy.random.Generator
    means, more : (N,) float64
        Finite and not negative: unchecked.
    factor : float
    """
    counts = np.empty(means.size, np.int64)
    fill_poisson((rng, word_streams(rng)), means, more, factor, counts, _MOST)
    return counts


def fill_poisson(
    source: tuple[np.random.Generator, NDArray[np.uint64]],
    means: NDArray[np.float64],
    more: NDArray[np.float64] | None,
    factor: float,
    counts: NDArray[np.integer[Any]],
    most: int,
) -> None:
    """Draw counts as `draw_poisson` into a contiguous (N,) array, none larger than `most`.

    The source is a generator and the `word_streams` drawn from it.
    """
    rng, streams = source
    rates = means, _NO_MORE if more is None else more, factor
    if _draw(streams, *rates, _tables(), counts, most):
        _draw_large(rng, *rates, counts, most)


@cache
def _tables() -> _Tables:
    multiples = np.arange(0, _LARGEST_MEAN, _COARSE), np.arange(0, _COARSE, _FINE)
    laws = [_law(mean) for mean in np.concatenate(multiples)]
    sizes = np.array([law.size for _, law in laws])
    return _Tables(
        np.cumsum(sizes) - sizes,
        np.array([65 - int(size).bit_length() for size in sizes], np.uint64),
        np.array([first for first, _ in laws]),
        np.concatenate([_alias_cells(law) for _, law in laws]),
    )


def _law(mean: float) -> tuple[int, NDArray[np.float64]]:
    """Least count, and the probabilities from there on, as many as a power of two."""
    reach = _TAIL * math.sqrt(mean) + _TAIL_COUNTS
    first, mode = int(max(mean - reach, 0)), int(mean)
    size = 2 ** int(mean + reach - first).bit_length()
    # P(n) is P(n − 1)·mean/n, from the most likely count on both ways
    below = np.cumprod(np.arange(mode, first, -1) / mean)[::-1]
    above = np.cumprod(mean / np.arange(mode + 1, first + size))
    law = np.concatenate((below, [1.0], above))
    return first, law / law.sum()


@njit(cache=True)  # type: ignore[untyped-decorator]
def _alias_cells(law: NDArray[np.float64]) -> NDArray[np.uint64]:
    """Make every cell as likely: those with too much of it stand in for those with too little."""
    share = law * law.size
    cells = np.empty(law.size, np.uint64)
    poor, rich = list(np.flatnonzero(share < 1)), list(np.flatnonzero(share >= 1))
    while poor and rich:
        cell, alias = poor.pop(), rich[-1]
        chance = np.uint64(share[cell] * 2.0**48)
        cells[cell] = (chance << _ALIAS_BITS) | np.uint64(alias)
        share[alias] -= 1 - share[cell]
        if share[alias] < 1:
            poor.append(rich.pop())
    for cell in poor + rich:  # full, but for rounding
        cells[cell] = (_CHANCE << _ALIAS_BITS) | np.uint64(cell)
    return cells


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _draw(
    streams: NDArray[np.uint64],
    means: NDArray[np.float64],
    more: NDArray[np.float64],
    factor: float,
    tables: _Tables,
    counts: NDArray[np.integer[Any]],
    most: int,
) -> bool:
    """Draw where the tables reach; whether there are larger means."""
    each = -1 if more.size > 1 else 0  # bits of the index that count in `more`
    has_fine = _any_reaches(means, more, _FINE / factor)
    has_large = False
    words = np.empty((_ROWS_OF_WORDS, LANES), np.uint64)
    word, used = words.reshape(-1), 1
    fill_words(streams, words)
    to_next_arrival = _wait(word[0])
    for index in range(means.size):
        if used > word.size - 2:
            fill_words(streams, words)
            used = 0
        mean = (means[index] + more[index & each]) * factor
        if mean >= _LARGEST_MEAN:
            has_large = True
            continue
        steps = int(mean / _FINE)
        count, coarse = 0, steps >> _FINE_PER_COARSE
        if coarse:
            count = _multiple(word[used], coarse, tables)
            used += 1
        if has_fine:
            fine = steps - (coarse << _FINE_PER_COARSE)
            count += _multiple(word[used], _COARSE_TABLES + fine, tables)
            used += 1
        to_next_arrival -= mean - steps * _FINE
        while to_next_arrival < 0:
            if used == word.size:
                fill_words(streams, words)
                used = 0
            to_next_arrival += _wait(word[used])
            used += 1
            count += 1
        counts[index] = min(count, most)
    return has_large


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _any_reaches(means: NDArray[np.float64], more: NDArray[np.float64], least: float) -> bool:
    number = np.int64(0)  # summed, which vector instructions do
    if more.size > 1:
        for index in range(means.size):
            number += np.int64(means[index] + more[index] >= least)
    else:
        for index in range(means.size):
            number += np.int64(means[index] + more[0] >= least)
    return bool(number > 0)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _wait(word: np.uint64) -> float:
    """Exponential wait for the next arrival, from a word: −log of a number within (0, 1)."""
    return -math.log((float(word >> np.uint64(11)) + 0.5) * 2.0**-53)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _draw_large(
    rng: np.random.Generator,
    means: NDArray[np.float64],
    more: NDArray[np.float64],
    factor: float,
    counts: NDArray[np.integer[Any]],
    most: int,
) -> None:
    each = -1 if more.size > 1 else 0
    for index in range(means.size):
        mean = (means[index] + more[index & each]) * factor
        if mean >= _LARGEST_MEAN:
            counts[index] = min(_near_normal(rng, mean), most)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _multiple(word: np.uint64, table: int, tables: _Tables) -> int:
    """Count of one table, from a word."""
    column = word >> tables.shift[table]
    cell = tables.cells[tables.start[table] + np.int64(column)]
    # no branch, which a processor would guess wrong half of the time
    is_own = np.uint64((word & _CHANCE) < (cell >> _ALIAS_BITS))
    alias = cell & _ALIAS
    return int(tables.first[table] + np.int64(alias + is_own * (column - alias)))


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _near_normal(rng: np.random.Generator, mean: float) -> int:
    sigma = math.sqrt(mean)
    while True:
        z = rng.standard_normal()
        n = near_normal_count(z, mean)
        chance = rng.random() * (sigma + _HIGH)
        if chance <= sigma - _LOW - abs(z) / 2 or chance <= acceptance(n, mean, z):
            return int(n)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def near_normal_count(z: float, mean: float) -> int:
    """Return the integer nearest to the quantile of a normal number."""
    sigma = math.sqrt(mean)
    quantile = mean + sigma * z + (z * z - 1) / 6 + (z - z**3) / (72 * sigma)
    return math.floor(quantile + 0.5)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def acceptance(n: float, mean: float, z: float) -> float:
    """√m·P(n)·y′(z)/φ(z), with Stirling's series for the factorial."""
    sigma, d = math.sqrt(mean), (mean - n) / n
    log = n * (math.log1p(d) - d) - (1 - 1 / (30 * n * n)) / (12 * n) + z * z / 2
    return math.exp(log) * math.sqrt(mean / n) * (sigma + z / 3 + (1 - 3 * z * z) / (72 * sigma))
