"""The long table of a benchmark: sources × methods × photons, one value for each and its interval.

Intervals are of what was measured on units that were sampled independently of each other, such as
sequences, scenes or windows of frames.

The logarithm of a mean, or of the ratio of two means over the same blocks, has the standard error
of the jackknife that leaves out one unit at a time (Efron and Tibshirani 1993, chapter 11), and
Student's quantiles. Units hold different numbers of blocks: their effective number (Kish 1965),
less one, are the degrees of freedom. A ratio of two methods does not inherit how hard the
units were. Other statistics, such as medians, have the percentiles of a bootstrap over units.

Pixels and frames of one sequence show the same things, so that its unit is a sequence; where there
are too few of them, it is a stretch of one, and what is found holds for these sequences alone.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from megalopta.core.arrays import Floats
from megalopta.sensor.sampling.streams import generator


class Case(NamedTuple):
    """One metric of one method at one number of photons, and where else it was measured."""

    metric: str
    method: str
    photons: float
    """Per frame or per pixel, as the benchmark says"""
    group: str = "all"
    """Which blocks"""
    pixels_pooled: int = 1
    """Side of the squares of pixels that are added"""
    frames_pooled: int = 1


Samples: TypeAlias = Mapping[Case, Floats]
"""What was measured, (units, draws) of the photons"""

Estimate: TypeAlias = Callable[[NDArray[Any], float], Iterator[tuple[str, Floats]]]
"""From counts (T, H, W) and their photons to the values (units,) of each metric"""


def measure_samples(
    draw: Callable[[float, int], NDArray[Any]],
    methods: Mapping[str, Estimate],
    fluxes: Sequence[float],
    draws: int,
    after_draw: Callable[[], object] = lambda: None,
) -> Samples:
    """Return what methods make of the same photons of one source.

    `draw` goes from photons (per frame or per pixel) and the number of a draw to counts (T, H, W).
    """
    found = defaultdict(list)
    for number, flux in product(range(draws), fluxes):
        counts = draw(flux, number)
        for name, estimate in methods.items():
            for metric, values in estimate(counts, flux):
                found[Case(metric, name, flux)].append(values)
        after_draw()
    return {case: np.stack(values, axis=-1) for case, values in found.items()}


def joined(sources: Iterable[Samples]) -> Samples:
    """Return the units of several sources, on which the same cases were measured, as one."""
    first, *others = sources
    return {
        case: np.concatenate([values, *(each[case] for each in others)])
        for case, values in first.items()
    }


FEWEST_SEQUENCES = 5
"""From so many on, sequences are the units"""

STRETCHES = 10
"""Of successive pairs of frames, into which each of fewer sequences is divided"""

_CONFIDENCE = 0.95
_REPLICATES = 2000


class Sums(NamedTuple):
    """Sum of what was measured and number of blocks, of each pair of frames or each unit, (n,)."""

    totals: Floats
    blocks: Floats


class Interval(NamedTuple):
    """A value and the bounds that hold it in 95 % of cases; None where units are too few."""

    value: float
    low: float | None = None
    high: float | None = None


def units(sequences: Sequence[Sums]) -> Sums:
    """Sum over the pairs of each unit: each sequence, or each stretch of few sequences."""
    stretches = 1 if len(sequences) >= FEWEST_SEQUENCES else STRETCHES
    sums = (
        [part.sum() for each in pairs for part in np.array_split(each, stretches)]
        for pairs in zip(*sequences, strict=True)
    )
    return Sums(*(np.array(each, np.float64) for each in sums))


def interval(sums: Sums) -> Interval | None:
    """Return the mean over all blocks and its interval; None where there are no blocks."""
    if not sums.blocks.any():
        return None
    there = _present(sums)
    spread = _spread(_log_means(there), there.blocks)
    return _around(_mean(sums), *spread) if spread else Interval(_mean(sums))


def ratio(one: Sums, other: Sums) -> tuple[Interval, float] | None:
    """Return the ratio of two means over the same blocks, and the two-sided p-value of its being 1.

    None where units are too few.
    """
    upper, lower = (_present(each) for each in (one, other))
    with np.errstate(invalid="ignore"):  # of two infinite ones
        left_out = _log_means(upper) - _log_means(lower)
    if (spread := _spread(left_out, upper.blocks)) is None:
        return None
    found, (error, freedom) = _mean(upper) / _mean(lower), spread
    steps = abs(np.log(found)) / max(error, np.finfo(float).eps)
    return _around(found, *spread), float(2 * student.sf(steps, freedom))


def _spread(left_out: Floats, blocks: Floats) -> tuple[float, float] | None:
    """Return standard error and degrees of freedom of a logarithm.

    From its values without each unit; None where units are too few.
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


def bootstrap(samples: Floats, statistic: Callable[[Floats], Floats], key: str) -> Interval:
    """Return a statistic of samples, and what holds it in 95 % of bootstraps over the units.

    The statistic goes from samples (..., units, draws) to (...,): draws of photons of one unit see
    the same things, and are drawn together. The key names the random numbers.
    """
    value, count = float(statistic(samples)), len(samples)
    if count == 1:  # which does not tell how much units differ
        return Interval(value)
    chosen = generator(0, key).integers(count, size=(_REPLICATES, count))
    low, high = np.percentile(statistic(samples[chosen]), (2.5, 97.5))
    return Interval(value, float(low), float(high))


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
