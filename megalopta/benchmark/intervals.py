"""Intervals of mean errors and of their ratios, from units that were sampled independently.

The logarithm of a mean, or of the ratio of two means over the same blocks, has the standard error
of the jackknife that leaves out one unit at a time (Efron and Tibshirani 1993, chapter 11), and
Student's quantiles. Units hold different numbers of blocks: their effective number (Kish 1965),
less one, are the degrees of freedom. A ratio of two methods does not inherit how hard the
units were.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from megalopta.benchmark.ranking_errors import Sums
from megalopta.core.arrays import Floats

_CONFIDENCE = 0.95


class Interval(NamedTuple):
    """A mean error (px per frame) and the bounds that hold it in 95 % of cases.

    Bounds are None where fewer than two units have blocks.
    """

    mean: float
    low: float | None
    high: float | None


class Ratio(NamedTuple):
    """A method's mean error over another's, what holds it in 95 % of cases, and its p-value."""

    ratio: float
    low: float
    high: float
    p: float
    """Two-sided, of the ratio being 1"""


class Best(NamedTuple):
    """The method with the lowest mean error."""

    method: str
    is_sure: bool
    """Whether the interval of every other method's ratio to it lies above 1"""


class _Spread(NamedTuple):
    standard_error: float
    freedom: float

    def factor(self) -> float:
        quantile = student.ppf((1 + _CONFIDENCE) / 2, self.freedom)
        return float(np.exp(quantile * self.standard_error))


def interval(sums: Sums) -> Interval | None:
    """Return the mean over all blocks and its interval; None where there are no blocks."""
    if not sums.blocks.any():
        return None
    mean, there = _mean(sums), _present(sums)
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = _spread(_log_means(there), there.blocks)
    if spread is None:
        return Interval(mean, None, None)
    return Interval(mean, mean / spread.factor(), mean * spread.factor())


def ratio(one: Sums, other: Sums) -> Ratio | None:
    """Return the ratio of two mean errors over the same blocks; None where it cannot be told."""
    upper, lower = (_present(each) for each in (one, other))
    with np.errstate(divide="ignore", invalid="ignore"):
        spread = _spread(_log_means(upper) - _log_means(lower), upper.blocks)
    if spread is None:
        return None
    found = float(_mean(upper) / _mean(lower))
    steps = abs(np.log(found)) / max(spread.standard_error, np.finfo(float).eps)
    p = float(2 * student.sf(steps, spread.freedom))
    return Ratio(found, found / spread.factor(), found * spread.factor(), p)


def best(sums: Mapping[str, Sums]) -> Best | None:
    """Return the best method, and whether the data can tell; None where there are no blocks."""
    means = {name: _mean(each) for name, each in sums.items() if each.blocks.any()}
    if not means:
        return None
    first = min(means, key=lambda name: means[name])
    ratios = [ratio(sums[name], sums[first]) for name in means if name != first]
    return Best(first, all(each is not None and each.low > 1 for each in ratios))


def _present(sums: Sums) -> Sums:
    there = sums.blocks > 0
    return Sums(sums.errors[there], sums.blocks[there])


def _mean(sums: Sums) -> float:
    return float(sums.errors.sum() / sums.blocks.sum())


def _log_means(sums: Sums) -> Floats:
    """Logarithm of the mean without each unit."""
    errors, blocks = (each.sum() - each for each in sums)
    return np.asarray(np.log(errors / blocks))


def _spread(left_out: Floats, blocks: Floats) -> _Spread | None:
    """Error of a logarithm, from its values without each unit; None where it cannot be told."""
    count = len(left_out)
    if count < 2 or not np.isfinite(left_out).all():
        return None
    freedom = float(blocks.sum() ** 2 / (blocks**2).sum() - 1)
    if freedom < 1:  # nearly all blocks are in one unit
        return None
    return _Spread(float(np.sqrt((count - 1) * left_out.var())), freedom)
