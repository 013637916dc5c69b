"""Histograms of the readings of pixels: whether their shapes differ, and how far apart they are.

The test is χ² on bins merged until each expects `_FEWEST` readings, less the part of it that says
that the means differ (the trend over bins, one degree of freedom): means have a test of their own,
which knows how sure they are. Distances, with F and G the shares of readings up to a value:

    total variation   ½·Σ |f − g|
    Wasserstein       Σ |F − G|           counts by which readings would have to move, on average
    energy            (2·Σ (F − G)²)^½    counts^½; Székely and Rizzo, J. Stat. Plan. Inference 2013

All are above 0 for finite samples of one law: `distances_by_chance` says by how much.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from megalopta.core.arrays import Floats

_FEWEST = 12.0
_ENTRIES_AT_ONCE = 4_000_000


class Distances(NamedTuple):
    """Between histograms of pixels, each (rows, columns)."""

    total_variation: Floats
    wasserstein: Floats
    energy: Floats


class HistogramTest(NamedTuple):
    """P-values (rows, columns), NaN where bins are too few, and distances."""

    p: Floats
    distances: Distances


def histogram_test(one: Floats, other: Floats) -> HistogramTest:
    """Test whether counts (n, rows, columns) have distributions of one shape, pixel by pixel."""
    shape = one.shape[1:]
    samples = [np.rint(each).astype(np.int64).reshape(len(each), -1) for each in (one, other)]
    at_once = max(_ENTRIES_AT_ONCE // _values(samples), 1)
    pieces = [
        _of_pixels([each[:, first : first + at_once] for each in samples])
        for first in range(0, samples[0].shape[1], at_once)
    ]
    p, *distances = (np.concatenate(each).reshape(shape) for each in zip(*pieces, strict=True))
    return HistogramTest(p, Distances(*distances))


def distances_by_chance(one: Floats, other: Floats) -> Distances:
    """Distances after frames (n, rows, columns) of both were dealt out anew: those of one law."""
    both = np.concatenate([one, other])
    order = np.random.default_rng(0).permutation(len(both))
    return histogram_test(both[order[: len(one)]], both[order[len(one) :]]).distances


def _values(samples: list[NDArray[np.int64]]) -> int:
    return int(max(each.max() for each in samples) - min(each.min() for each in samples)) + 1


def _of_pixels(samples: list[NDArray[np.int64]]) -> tuple[Floats, Floats, Floats, Floats]:
    """P-values and three distances of pixels, of samples (n, P)."""
    least, size = min(int(each.min()) for each in samples), _values(samples)
    pixels = samples[0].shape[1]
    seen = np.empty((2, pixels, size))
    for place, each in enumerate(samples):
        key = each - least + size * np.arange(pixels)
        seen[place] = np.bincount(key.ravel(), minlength=pixels * size).reshape(pixels, size)
    totals = np.array([len(each) for each in samples], np.float64)
    shares = seen / totals[:, None, None]
    apart = np.cumsum(shares[0] - shares[1], axis=1)
    return (
        _p(seen, totals),
        np.abs(shares[0] - shares[1]).sum(axis=1) / 2,
        np.abs(apart).sum(axis=1),
        np.sqrt(2 * np.square(apart).sum(axis=1)),
    )


def _p(seen: Floats, totals: Floats) -> Floats:
    both = seen.sum(axis=0)
    pixels, size = both.shape
    expected = both * totals.min() / totals.sum()
    most = np.maximum(expected.sum(axis=1, keepdims=True) // _FEWEST - 1, 0)
    group = np.minimum(np.cumsum(expected, axis=1) // _FEWEST, most).astype(np.int64)
    groups = int(group.max()) + 1
    key = (group + groups * np.arange(pixels)[:, None]).ravel()

    def merged(values: Floats) -> Floats:
        sums = np.bincount(key, values.ravel(), pixels * groups).astype(np.float64)
        return sums.reshape(pixels, groups)

    first, all_ = merged(seen[0]), merged(both)
    place = merged(both * np.arange(size)) / np.maximum(all_, 1)
    excess = first - all_ * totals[0] / totals.sum()
    scale = totals.prod() / totals.sum() ** 2
    squares = (excess**2 / np.maximum(all_, 1)).sum(axis=1) / scale
    centered = place - (place * all_).sum(axis=1, keepdims=True) / totals.sum()
    spread = (all_ * centered**2).sum(axis=1)
    trend = (excess * centered).sum(axis=1) ** 2 / np.where(spread > 0, spread, 1) / scale
    freedom = (all_ > 0).sum(axis=1) - 2
    p = chi2.sf(np.maximum(squares - trend, 0), np.maximum(freedom, 1))
    return np.where(freedom > 0, p, np.nan)
