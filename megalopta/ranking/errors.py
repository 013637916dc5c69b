"""Errors of all methods by group of blocks, with intervals, and which method is the best.

A block's error is the endpoint error in px of the full image per frame; a block without velocity
counts as one that answered 0. Means are over all blocks of a group. Intervals are of a bootstrap
over pairs of frames, with the same pairs for all methods, so that a difference between two methods
does not inherit how hard the pairs were.
"""

from collections.abc import Mapping, Sequence
from itertools import permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.arrays import Floats
from megalopta.ranking.truth import BlockTruths

STILL = "answer 0"
"""What a method must beat: no motion anywhere"""

_REPLICATES = 1000
_CONFIDENCE = 0.95


class PairSums(NamedTuple):
    """Sum of errors and number of blocks, of each pair of frames, (pairs,)."""

    errors: Floats
    blocks: Floats


class Interval(NamedTuple):
    """A mean error (px per frame) and the bounds that hold it in 95 % of cases."""

    mean: float
    low: float
    high: float


class Best(NamedTuple):
    """The method with the lowest mean error."""

    method: str
    is_sure: bool
    """Whether it is the lowest in 95 % of the replicates"""


def endpoint_errors(velocities: Floats, truth: BlockTruths) -> Floats:
    """Return the endpoint errors (pairs, rows, columns) of the blocks inside."""
    inside = velocities[:, 1:-1, 1:-1]
    answered = np.isfinite(inside).all(axis=-1, keepdims=True)
    return np.asarray(np.linalg.norm(np.where(answered, inside, 0) - truth.velocities, axis=-1))


def pair_sums(errors: Sequence[Floats], among: NDArray[np.bool_]) -> PairSums:
    """Sum errors (pairs, rows, columns) of several draws over the blocks of a group."""
    total = np.sum([np.where(among, each, 0).sum(axis=(1, 2)) for each in errors], axis=0)
    return PairSums(np.asarray(total), len(errors) * among.sum(axis=(1, 2)).astype(np.float64))


def joined(parts: Sequence[PairSums]) -> PairSums:
    """Return the pairs of several sequences as one."""
    return PairSums(*(np.concatenate(each) for each in zip(*parts, strict=True)))


class Replicates:
    """Means over resampled pairs of frames, the same pairs for every method."""

    def __init__(self, pairs: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self._weights = rng.multinomial(pairs, np.full(pairs, 1 / pairs), _REPLICATES)

    def means(self, sums: PairSums) -> Floats:
        """Return the mean of each replicate, NaN where it holds no block of the group."""
        with np.errstate(invalid="ignore"):
            return np.asarray((self._weights @ sums.errors) / (self._weights @ sums.blocks))

    def interval(self, sums: PairSums) -> Interval | None:
        """Return the mean and its interval; None where there are no blocks."""
        if not sums.blocks.any():
            return None
        tails = (1 - _CONFIDENCE) / 2 * np.array([1, -1]) + [0, 1]
        low, high = np.nanquantile(self.means(sums), tails)
        return Interval(float(sums.errors.sum() / sums.blocks.sum()), float(low), float(high))

    def best(self, sums: Mapping[str, PairSums]) -> Best | None:
        """Return the best method, and whether the data can tell; None where there are no blocks."""
        means = {
            name: each.errors.sum() / each.blocks.sum()
            for name, each in sums.items()
            if each.blocks.any()
        }
        if not means:
            return None
        best = min(means, key=lambda name: means[name])
        own = self.means(sums[best])
        wins = np.all([own <= self.means(sums[name]) for name in means if name != best], axis=0)
        return Best(best, bool(np.mean(wins) >= _CONFIDENCE))

    def order(self, sums: Mapping[str, PairSums]) -> list[tuple[str, str]]:
        """Return which method is better than which other in 95 % of the replicates."""
        means = {name: self.means(each) for name, each in sums.items() if each.blocks.any()}
        return [
            (better, worse)
            for better, worse in permutations(means, 2)
            if np.mean(means[better] < means[worse]) >= _CONFIDENCE
        ]
