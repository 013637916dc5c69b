"""Poisson counts, drawn faster than NumPy does.

A Poisson count is the sum of independent ones whose means add up. Below 2048 the mean is cut into a
multiple of 16, one of 1/16, and a rest. The multiples have alias tables, which turn a random word
into a count by one comparison, to 2⁻⁴⁸: Walker, ACM Trans. Math. Softw. 3, 253 (1977). The rest is
the number of arrivals of a process of rate one that runs on from draw to draw, so it costs a
subtraction as long as nothing arrives. Whether any mean has a multiple of 1/16 is asked of a frame
and not of each pixel, which in dim light a processor would guess wrong every other time.

From 2048 on, counts come of normal numbers (`near_normal`).
"""

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from megalopta.sensor.sampling.near_normal import is_accepted, near_normal, near_normal_count
from megalopta.sensor.sampling.normals import EDGES, quick_normal, slow_normal
from megalopta.sensor.sampling.words import LANES, fill_words, uniform, word_streams

_COARSE, _FINE = 16.0, 1 / 16
"""Powers of two: sums are exact. The finer, the rarer an arrival, the larger its table."""
_FINE_PER_COARSE = np.uint64(8)
"""Binary digits of a mean in units of the fine step that are below the coarse one."""
_LARGEST_MEAN = 2048.0
"""Of the tables"""
_COARSE_TABLES = np.uint64(_LARGEST_MEAN / _COARSE)
_TAIL = 8.0
"""Standard deviations of a table on each side, and counts beyond them; what is farther out is less
likely than the rounding of a random word."""
_TAIL_COUNTS = 20

_CHANCE = np.uint64(2**48 - 1)
_ALIAS_BITS, _ALIAS = np.uint64(16), np.uint64(2**16 - 1)
_ROWS_OF_WORDS = 64
_ONE, _TWO, _ALL = np.uint64(1), np.uint64(2), ~np.uint64(0)
_NO_MORE = np.zeros(1)
_NO_MORE.flags.writeable = (
    False  # as dark counts of a device are, for which `_draw` is compiled anyway
)
_MOST = int(np.iinfo(np.int64).max)


class _Tables(NamedTuple):
    """Alias tables of the multiples of the coarse step, then of the fine one."""

    heads: NDArray[np.uint64]
    """Of each table: its first cell; what moves the leading bits of a word, which choose the cell,
    to its end; the count of its first cell"""

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
    rates = means, _NO_MORE if more is None else more, factor
    if _draw(source[1], *rates, _tables(), counts, most):
        _draw_large(source, *rates, EDGES, counts, most)


@cache
def _tables() -> _Tables:
    multiples = np.arange(0, _LARGEST_MEAN, _COARSE), np.arange(0, _COARSE, _FINE)
    laws = [_law(mean) for mean in np.concatenate(multiples)]
    sizes = np.array([law.size for _, law in laws])
    starts, shifts = np.cumsum(sizes) - sizes, [65 - int(size).bit_length() for size in sizes]
    return _Tables(
        np.column_stack((starts, shifts, [first for first, _ in laws])).astype(np.uint64),
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
    # all indices are unsigned: Python's negative ones would cost a comparison each
    each = _ALL if more.size > 1 else np.uint64(0)  # bits of the index that count in `more`
    has_fine = _any_reaches(means, more, _FINE / factor)
    has_large = False
    words = np.empty((_ROWS_OF_WORDS, LANES), np.uint64)
    word, used, size = words.reshape(-1), _ONE, np.uint64(words.size)
    fill_words(streams, words)
    to_next_arrival = _wait(word[0])
    for index in range(means.size):
        if used + _ONE >= size:
            fill_words(streams, words)
            used = np.uint64(0)
        mean = (means[index] + more[index & each]) * factor
        if mean >= _LARGEST_MEAN:
            has_large = True
            continue
        steps = np.uint64(mean / _FINE)
        count, coarse = np.uint64(0), steps >> _FINE_PER_COARSE
        if coarse:
            count = _multiple(word[used], coarse, tables)
            used += _ONE
        if has_fine:
            fine = steps - (coarse << _FINE_PER_COARSE)
            count += _multiple(word[used], _COARSE_TABLES + fine, tables)
            used += _ONE
        to_next_arrival -= mean - float(steps) * _FINE
        while to_next_arrival < 0:
            if used == size:
                fill_words(streams, words)
                used = np.uint64(0)
            to_next_arrival += _wait(word[used])
            used += _ONE
            count += _ONE
        counts[index] = min(int(np.int64(count)), most)
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
    """Exponential wait for the next arrival, from a word."""
    return -math.log(uniform(word))


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _multiple(word: np.uint64, table: np.uint64, tables: _Tables) -> np.uint64:
    """Count of one table, from a word."""
    head = tables.heads[table]
    column = word >> head[1]
    cell = tables.cells[head[0] + column]
    # no branch, which a processor would guess wrong half of the time
    is_own = np.uint64((word & _CHANCE) < (cell >> _ALIAS_BITS))
    alias = cell & _ALIAS
    return np.uint64(head[2] + alias + is_own * (column - alias))


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _draw_large(
    source: tuple[np.random.Generator, NDArray[np.uint64]],
    means: NDArray[np.float64],
    more: NDArray[np.float64],
    factor: float,
    edges: NDArray[np.float64],
    counts: NDArray[np.integer[Any]],
    most: int,
) -> None:
    """Draw where the tables do not reach."""
    rng, streams = source
    each = _ALL if more.size > 1 else np.uint64(0)
    words = np.empty((_ROWS_OF_WORDS, LANES), np.uint64)
    word, size = words.reshape(-1), np.uint64(words.size)
    used = size
    for index in range(means.size):
        mean = (means[index] + more[index & each]) * factor
        if mean < _LARGEST_MEAN:
            continue
        if used == size:
            fill_words(streams, words)
            used = np.uint64(0)
        z = quick_normal(word[used], edges)
        if math.isnan(z):
            z = slow_normal(word[used], edges, rng)
        n = near_normal_count(z, mean)
        if not is_accepted(n, mean, z, uniform(word[used + _ONE])):
            n = near_normal(rng, mean)
        counts[index] = min(n, most)
        used += _TWO
