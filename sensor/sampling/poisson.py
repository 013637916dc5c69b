"""Poisson counts, drawn faster than NumPy does for means below some thousands.

Two to seven times as fast where all means are equal, twice where they differ from draw to draw,
and 0.6 times as fast at means of 10⁵.

A Poisson count is the sum of independent ones whose means add up. The mean is cut into multiples of
4096, of 64 and of 1/8, and a rest. The multiples have tables: inversion of the distribution
function from a guide into it, Chen and Asau, AIIE Transactions 6, 163 (1974). The rest is the
number of arrivals of a process of rate one that runs on from draw to draw, so it costs a
subtraction as long as nothing arrives. From 65 536 on it is NumPy's transformed rejection, and from
10¹² on, where that loses digits, the normal law, whose skewness is wrong by 10⁻⁶.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import pdtr

_STEPS = (4096.0, 64.0, 1 / 8)
"""Powers of two: sums are exact. The finer the last, the rarer an arrival, the larger its table."""
_LARGEST_MEAN = 65_536.0
"""Of the tables"""
_NORMAL_MEAN = 1e12
_TAIL = 9.0
"""Standard deviations of a table on each side, and counts beyond them; what is farther out is less
likely than the rounding of a uniform number."""
_TAIL_COUNTS = 45


class _Table(NamedTuple):
    """Distribution functions of the multiples of a step."""

    rows_per_count: float
    """One over the step"""

    first: NDArray[np.int64]
    """Smallest count of each row"""

    cumulative: NDArray[np.float64]
    """P(X ≤ first + column)"""

    guides: NDArray[np.uint16]
    """Column where the search for a uniform number begins, by its leading bits"""


def draw_poisson(rng: np.random.Generator, means: NDArray[np.float64]) -> NDArray[np.int64]:
    """Draw one count for each of the means, (N,), which are finite and not negative: unchecked."""
    return np.asarray(_draw(rng, means, *_tables()))


@cache
def _tables() -> tuple[_Table, ...]:
    """Return the tables of all steps, the largest first."""
    ends = (_LARGEST_MEAN, *_STEPS)
    return tuple(_table(end, step) for end, step in zip(ends, _STEPS, strict=False))


def _table(end: float, step: float) -> _Table:
    means = np.arange(0, end, step)
    reach = _TAIL * np.sqrt(means) + _TAIL_COUNTS
    first = np.maximum(means - reach, 0).astype(np.int64)
    width = int(np.max(means + reach - first)) + 1
    cumulative = np.asarray(pdtr(first[:, np.newaxis] + np.arange(width), means[:, np.newaxis]))
    cumulative[:, -1] = np.inf
    n_guides = 2 * 2 ** math.ceil(math.log2(width))
    starts = np.arange(n_guides) / n_guides
    guides = [np.searchsorted(row, starts, side="right") for row in cumulative]
    return _Table(1 / step, first, cumulative, np.array(guides, np.uint16))


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _draw(
    rng: np.random.Generator,
    means: NDArray[np.float64],
    coarse: _Table,
    medium: _Table,
    fine: _Table,
) -> NDArray[np.int64]:
    counts = np.empty(means.size, np.int64)
    to_next_arrival = rng.standard_exponential()
    for index in range(means.size):
        if means[index] >= _NORMAL_MEAN:
            counts[index] = round(means[index] + np.sqrt(means[index]) * rng.standard_normal())
            continue
        if means[index] >= _LARGEST_MEAN:
            counts[index] = rng.poisson(means[index])
            continue
        count, rest = 0, means[index]
        if rest >= _STEPS[0]:
            count, rest = _whole_steps(rng, coarse, count, rest)
        if rest >= _STEPS[1]:
            count, rest = _whole_steps(rng, medium, count, rest)
        if rest >= _STEPS[2]:
            count, rest = _whole_steps(rng, fine, count, rest)
        to_next_arrival -= rest
        while to_next_arrival < 0:
            to_next_arrival += rng.standard_exponential()
            count += 1
        counts[index] = count
    return counts


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _whole_steps(
    rng: np.random.Generator, table: _Table, count: int, mean: float
) -> tuple[int, float]:
    """Return a count with the draw of the whole steps in a mean added, and the mean's rest."""
    row = int(mean * table.rows_per_count)
    uniform = rng.random()
    column = int(table.guides[row, int(uniform * table.guides.shape[1])])
    while table.cumulative[row, column] <= uniform:
        column += 1
    return count + int(table.first[row]) + column, mean - row / table.rows_per_count
