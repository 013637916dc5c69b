"""The long table of a benchmark: sources × methods × photons, a value and an interval each.

Intervals are over units that were sampled independently, such as sequences, scenes or windows of
frames.

The logarithm of a mean, or of the ratio of two means over the same blocks, has the standard error
of the jackknife over units (Efron and Tibshirani 1993, chapter 11), and Student's quantiles. Units
hold different numbers of blocks: their effective number (Kish 1965), less one, is the number of
degrees of freedom. A ratio of two methods does not depend on how hard the units were.

Pixels and frames of a sequence show the same scene, so the unit is a sequence. With too few
sequences it is a segment of one, and results hold for these sequences alone.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from megalopta.core.arrays import Floats


class Case(NamedTuple):
    """One metric of one method at one number of photons, with its group and pooling."""

    metric: str
    method: str
    photons: float
    """Per frame or per pixel, depending on the benchmark"""
    group: str = "all"
    """Group of blocks"""
    pixels_pooled: int = 1
    """Side of the squares of pixels that are added"""
    frames_pooled: int = 1


Samples: TypeAlias = Mapping[Case, Floats]
"""Measured values, (units, photon draws)"""

Measure: TypeAlias = Callable[[NDArray[Any], float], Iterator[tuple[str, str, Floats]]]
"""Maps counts (T, H, W) and their photons to the values (units,) of each metric and method"""


def measure_samples(
    draw: Callable[[float, int], NDArray[Any]],
    measure: Measure,
    fluxes: Sequence[float],
    draws: int,
    after_draw: Callable[[], object] = lambda: None,
) -> Samples:
    """Return what methods measure on the same photons of one source.

    `draw` maps photons (per frame or per pixel) and the number of a draw to counts (T, H, W).
    """
    found = defaultdict(list)
    for number, flux in product(range(draws), fluxes):
        for metric, method, values in measure(draw(flux, number), flux):
            found[Case(metric, method, flux)].append(values)
        after_draw()
    return {case: np.stack(values, axis=-1) for case, values in found.items()}


def gathered(sources: Iterable[Samples]) -> Samples:
    """Join the units of several sources on which the same cases were measured."""
    first, *others = sources
    return {
        case: np.concatenate([values, *(each[case] for each in others)])
        for case, values in first.items()
    }


FEWEST_SEQUENCES = 5
"""Least number of sequences for sequences to be the units"""

STRETCHES = 10
"""Segments of successive pairs of frames per sequence, if sequences are fewer"""

_CONFIDENCE = 0.95


class Sums(NamedTuple):
    """Sum of the measured values and number of blocks, per pair of frames or unit, (n,)."""

    totals: Floats
    blocks: Floats


class Interval(NamedTuple):
    """A value and its 95 % interval; None if units are too few."""

    value: float
    low: float | None = None
    high: float | None = None


def units(sequences: Sequence[Sums]) -> Sums:
    """Sum over the pairs of each unit: each sequence, or each segment of few sequences."""
    stretches = 1 if len(sequences) >= FEWEST_SEQUENCES else STRETCHES
    sums = (
        [part.sum() for each in pairs for part in np.array_split(each, stretches)]
        for pairs in zip(*sequences, strict=True)
    )
    return Sums(*(np.array(each, np.float64) for each in sums))


def interval(sums: Sums) -> Interval | None:
    """Return the mean over all blocks and its interval; None if there are no blocks."""
    if not sums.blocks.any():
        return None
    there = _present(sums)
    spread = _spread(_log_means(there), there.blocks)
    return _around(_mean(sums), *spread) if spread else Interval(_mean(sums))


def sums_of(samples: Floats) -> Sums:
    """Return the sums over the draws of samples (units, draws); NaN is unknown."""
    known = np.isfinite(samples)
    return Sums(np.where(known, samples, 0).sum(axis=-1), known.sum(axis=-1))


def mean_of(samples: Floats) -> Interval:
    """Return the mean of samples (units, draws) and its interval over units; NaN is unknown."""
    return interval(sums_of(samples)) or Interval(math.nan)


def ratio(one: Sums, other: Sums) -> tuple[Interval, float] | None:
    """Return the ratio of two means over the same blocks, and its two-sided p-value against 1.

    None if units are too few.
    """
    upper, lower = (_present(each) for each in (one, other))
    with np.errstate(invalid="ignore"):  # ratio of two infinities
        left_out = _log_means(upper) - _log_means(lower)
    if (spread := _spread(left_out, upper.blocks)) is None:
        return None
    found, (error, freedom) = _mean(upper) / _mean(lower), spread
    steps = abs(np.log(found)) / max(error, np.finfo(float).eps)
    return _around(found, *spread), float(2 * student.sf(steps, freedom))


def is_larger(one: Sums, other: Sums) -> bool:
    """Return whether the mean of one surely exceeds that of the other over the same blocks."""
    found = ratio(one, other)
    return found is not None and (found[0].low or 0) > 1


def _spread(left_out: Floats, blocks: Floats) -> tuple[float, float] | None:
    """Return standard error and degrees of freedom of a logarithm.

    Computed from its values without each unit; None if units are too few.
    """
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
    there = sums.blocks > 0
    return Sums(sums.totals[there], sums.blocks[there])


def _mean(sums: Sums) -> float:
    return float(sums.totals.sum() / sums.blocks.sum())


def _log_means(sums: Sums) -> Floats:
    """Return the logarithm of the mean without each unit."""
    totals, blocks = (each.sum() - each for each in sums)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.log(totals / blocks))
