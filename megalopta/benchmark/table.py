"""The long table of a benchmark: what was measured on every unit, and means with their intervals.

A unit is sampled independently of all others: a scene or sequence, or a segment of few sequences,
of which results hold for these sequences alone.

The logarithm of a mean, or of the ratio of two means over the same blocks, has the standard error
of the jackknife over units (Efron and Tibshirani 1993, chapter 11), and Student's quantiles. Units
hold different numbers of blocks: their effective number (Kish 1965), less one, is the number of
degrees of freedom.
"""

import math
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import t as student

from megalopta.core.arrays import Floats

CASE = ["metric", "method", "photons", "group"]
"""Columns that say what a row measures: photons are per frame or per pixel, as the benchmark says;
group is a group of blocks, or a disturbance"""

MEDIAN, MEAN, FAR = "median_epe_px", "mean_epe_px", "share_beyond_3_px"
"""Metrics of the endpoint errors of a pair of frames, over blocks or pixels"""
NONE = "share_without_flow"
"""Blocks or pixels with known truth to which a method gives no flow"""
FEWEST_UNITS = 5
"""With fewer units an interval is wide, and depends on their distribution"""
FAR_PX = 3.0
"""Endpoint error from which a block or pixel counts as far off"""

_CONFIDENCE = 0.95


class Sums(NamedTuple):
    """Sum of the measured values and number of blocks of each unit, (n,)."""

    totals: Floats
    blocks: Floats


class Interval(NamedTuple):
    """A value and its 95 % interval, NaN if units are too few."""

    value: float
    low: float = math.nan
    high: float = math.nan


def samples(rows: Iterable[tuple[Any, ...]]) -> pd.DataFrame:
    """Return the table of measured values: a row for each case and unit.

    A row is (metric, method, photons, group, unit, total, blocks).
    """
    return pd.DataFrame(list(rows), columns=[*CASE, "unit", "total", "blocks"])


def records(rows: pd.DataFrame) -> Iterator[Any]:
    """Yield the rows of a table, with columns as attributes."""
    yield from rows.itertuples()


def means(table: pd.DataFrame, not_ranked: str = "", against: str = "") -> pd.DataFrame:
    """Return the mean of every case over units: value, low, high and `surely_lowest`.

    The last is true if the value is lower than that of every other method but `not_ranked`.
    `difference` is from the method in `against`, by default the lowest, and `difference_half` half
    its paired interval. Cases without blocks are excluded.
    """
    rows = []
    for (metric, *case), same in table.groupby(["metric", *CASE[2:]], sort=False):
        sums = {name: of_all for name, of_all in by_method(same).items() if of_all.blocks.any()}
        ranked = [name for name in sums if name != not_ranked] or list(sums)
        first = min(ranked, key=lambda name: mean(sums[name]), default="")
        gaps = [difference(sums[name], sums[first]) for name in ranked if name != first]
        is_sure, base = all(gap > half for gap, half in gaps), against if against in sums else first
        for name, of_method in sums.items():
            is_lowest, gap = is_sure and name == first, difference(of_method, sums[base])
            value, low, high = interval(of_method)
            high = min(high, 1.0) if metric in (FAR, NONE) else high
            rows.append((metric, name, *case, value, low, high, is_lowest, base, *gap))
    columns = ["value", "low", "high", "surely_lowest", "against", "difference", "difference_half"]
    return pd.DataFrame(rows, columns=[*CASE, *columns])


def by_method(rows: pd.DataFrame) -> dict[str, Sums]:
    """Return the sums over the units of every method, of the rows of one case."""
    return {
        str(name): Sums(part["total"].to_numpy(float), part["blocks"].to_numpy(float))
        for name, part in rows.groupby("method", sort=False)
    }


def interval(sums: Sums) -> Interval:
    """Return the mean over all blocks and its interval."""
    present = _present(sums)
    spread = _spread(_log_means(present), present.blocks)
    return _around(mean(sums), *spread) if spread else Interval(mean(sums))


def ratio(upper: Sums, lower: Sums) -> Interval | None:
    """Return the ratio of two means over the same blocks; None if units are too few."""
    upper, lower = _present(upper), _present(lower)
    with np.errstate(invalid="ignore"):  # ratio of two infinities
        left_out = _log_means(upper) - _log_means(lower)
    spread = _spread(left_out, upper.blocks)
    return _around(mean(upper) / mean(lower), *spread) if spread else None


def difference(upper: Sums, lower: Sums) -> tuple[float, float]:
    """Return the difference of two means over the same blocks, and half its interval or NaN.

    Of units of one size, the interval is Student's of paired values.
    """
    upper, lower = _present(upper), _present(lower)
    with np.errstate(invalid="ignore"):  # of a single unit
        spread = _spread(_means_without_each(upper) - _means_without_each(lower), upper.blocks)
    half = student.ppf((1 + _CONFIDENCE) / 2, spread[1]) * spread[0] if spread else math.nan
    return mean(upper) - mean(lower), float(half)


def _spread(left_out: Floats, blocks: Floats) -> tuple[float, float] | None:
    """Return standard error and degrees of freedom of a logarithm, from it without each unit."""
    count = len(left_out)
    if count < 2 or not np.isfinite(left_out).all():
        return None
    freedom = float(blocks.sum() ** 2 / (blocks**2).sum() - 1)
    if freedom < 1:  # nearly all blocks are in one unit
        return None
    return float(np.sqrt((count - 1) * left_out.var())), freedom


def _around(value: float, error: float, freedom: float) -> Interval:
    factor = float(np.exp(student.ppf((1 + _CONFIDENCE) / 2, freedom) * error))
    return Interval(value, value / factor, value * factor)


def _present(sums: Sums) -> Sums:
    has_blocks = sums.blocks > 0
    return Sums(sums.totals[has_blocks], sums.blocks[has_blocks])


def mean(sums: Sums) -> float:
    """Return the mean over all blocks."""
    return float(sums.totals.sum() / sums.blocks.sum())


def _log_means(sums: Sums) -> Floats:
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(_means_without_each(sums)))


def _means_without_each(sums: Sums) -> Floats:
    totals, blocks = (values.sum() - values for values in sums)
    return np.asarray(totals / np.where(blocks, blocks, np.nan))
