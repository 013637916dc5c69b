"""Crosstalk: an avalanche sends light to its neighbors and may fire them.

Every counted avalanche fires each of its 4 (or 8) neighbors with probability p/4 (p/8), at once and
independently; an avalanche so fired does the same. Beyond the edge of the array there is nothing.
Crosstalk light that meets a pixel in its dead time is an arrival like any other: lost, and it
extends a paralyzable dead time.

Without dead time the counts are a branching process. K being the sum over neighbors and c = p/4 (or
p/8), with means N̄ = λ + c·K·N̄ of Poisson primaries λ and the response G = (1 − c·K)⁻¹,

    Var(N_i) = Σ_j G_ij²·D_j,     D = λ + c·(1−c)·K·N̄

Var uses the response of an unbounded array, so at the border it is high: in a corner by 4c² of
itself for small c, at an edge by half of that (2.4 % and 1.2 % at p = 0.3 and four neighbors).

Source: dissertation §2.3.2.
"""

from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.ndimage import convolve

from megalopta.sensor.effects.base import Effect, Stage

_NEGLIGIBLE = 1e-15
_RESPONSE_HALF_WIDTH = 12

Floats = NDArray[np.float64]


class Crosstalk(Effect, frozen=True):
    """How strongly avalanches fire neighboring pixels; off by default."""

    stage: ClassVar[Stage] = Stage.AVALANCHES
    statement: ClassVar[str] = "avalanches send light to neighboring pixels"

    probability: Annotated[float, Field(ge=0, le=0.8)] = 0.0
    """Mean number of neighbors that one avalanche inside the array fires (0: no crosstalk)."""
    neighbors: Literal[4, 8] = 4
    """How many neighbors share it: those across an edge, or across a corner too."""

    @property
    def is_on(self) -> bool:
        """Whether any neighbor is fired."""
        return self.probability > 0


def neighborhood(crosstalk: Crosstalk) -> Floats:
    """Return (3, 3) probabilities that an avalanche in the middle fires a neighbor."""
    weights = np.ones((3, 3))
    if crosstalk.neighbors == 4:
        weights[::2, ::2] = 0
    weights[1, 1] = 0
    return weights * (crosstalk.probability / crosstalk.neighbors)


def spread(
    rng: np.random.Generator, primaries: NDArray[np.int64], crosstalk: Crosstalk
) -> NDArray[np.int64]:
    """Draw the counts with crosstalk of one (rows, columns) frame of primary counts."""
    if not crosstalk.is_on:
        return primaries
    weights = neighborhood(crosstalk)
    counts, generation = primaries.copy(), primaries
    while generation.any():
        generation = _fired(rng, generation, weights)
        counts += generation
    return counts


def _fired(
    rng: np.random.Generator, generation: NDArray[np.int64], weights: Floats
) -> NDArray[np.int64]:
    padded = np.zeros(np.add(generation.shape, 2), np.int64)
    rows, columns = generation.shape
    for row, column in np.argwhere(weights):
        shifted = padded[row : row + rows, column : column + columns]
        shifted += rng.binomial(generation, weights[row, column])
    return padded[1:-1, 1:-1]


def fired_mean(counts: Floats, crosstalk: Crosstalk) -> Floats:
    """Mean number of avalanches fired in each pixel by these mean counts of its neighbors."""
    return np.asarray(convolve(counts, neighborhood(crosstalk), mode="constant"))


def mean(primaries: Floats, crosstalk: Crosstalk) -> Floats:
    """Mean counts of a (rows, columns) frame without dead time, from the mean primaries."""
    total, generation = primaries.copy(), primaries
    while generation.max(initial=0) > _NEGLIGIBLE * total.max(initial=0):
        generation = fired_mean(generation, crosstalk)
        total += generation
    return total


def variance(primaries: Floats, crosstalk: Crosstalk) -> Floats:
    """Variance of the counts of a frame without dead time, for Poisson primaries of this mean."""
    weights = neighborhood(crosstalk)
    size = 2 * _RESPONSE_HALF_WIDTH + 1
    impulse = np.zeros((size, size))
    impulse[_RESPONSE_HALF_WIDTH, _RESPONSE_HALF_WIDTH] = 1
    response = mean(impulse, crosstalk)
    offspring = convolve(mean(primaries, crosstalk), weights * (1 - weights), mode="constant")
    return np.asarray(convolve(primaries + offspring, response**2, mode="constant"))
