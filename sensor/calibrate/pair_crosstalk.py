"""Crosstalk from measured probabilities of pairs of pixels.

The probability that an avalanche in one of two pixels fires the other, as coincidences of dark
counts give it, fitted by `Crosstalk`: the mean over the pairs at each distance that it knows. Means
are not weighted: what differs between pairs, not counting, is most of their scatter.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Mask
from megalopta.sensor.effects.crosstalk import Crosstalk, neighborhoods


class PairCrosstalk(NamedTuple):
    """Crosstalk of pairs of pixels, each (M,)."""

    down: NDArray[np.int64]
    """Distance in rows, without sign"""
    right: NDArray[np.int64]
    column: Floats
    """Mean column of both pixels"""
    probability: Floats
    error: Floats

    def some(self, chosen: Mask) -> "PairCrosstalk":
        """Return a part of the pairs."""
        return PairCrosstalk._make(each[chosen] for each in self)

    def at(self, down: int, right: int) -> "PairCrosstalk":
        """Return the pairs at a distance."""
        return self.some((self.down == down) & (self.right == right))


def fit_crosstalk(pairs: PairCrosstalk) -> Crosstalk:
    """Return crosstalk with the mean probability of the pairs at each distance.

    Raises ValueError without pairs of edge neighbors, or if these show no crosstalk.
    """
    edge, diagonal, two, three = (
        _mean(pairs, places)
        for places in (((0, 1), (1, 0)), ((1, 1),), ((0, 2), (2, 0)), ((0, 3), (3, 0)))
    )
    if not edge > 0:
        raise ValueError("no crosstalk between edge neighbors; give pairs at a distance of 1")
    shares = [float(np.clip(each / edge, 0, 1)) for each in (diagonal, two, three)]
    return Crosstalk(
        mean_fired_neighbors=4 * edge * (1 + sum(shares)),
        diagonal=shares[0],
        distance_two=shares[1],
        distance_three=shares[2],
    )


def _mean(pairs: PairCrosstalk, places: tuple[tuple[int, int], ...]) -> float:
    values = np.concatenate([pairs.at(*place).probability for place in places])
    return float(values.mean()) if values.size else 0.0


def modelled(crosstalk: Crosstalk, pairs: PairCrosstalk) -> Floats:
    """Return the probability that the model gives each pair."""
    weights = neighborhoods(crosstalk).mean(axis=(0, 1))
    # which way a pair lies is not known
    weights = (weights + weights[::-1] + weights[:, ::-1] + weights[::-1, ::-1]) / 4
    rows, columns = (side // 2 for side in weights.shape)
    within = (pairs.down <= rows) & (pairs.right <= columns)
    down, right = np.where(within, pairs.down, 0), np.where(within, pairs.right, 0)
    return np.asarray(weights[rows + down, columns + right])
