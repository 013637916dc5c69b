"""Crosstalk: an avalanche emits light that may fire its neighbors.

Every counted avalanche fires nearby pixels at once and independently, with a probability that falls
with distance: c across an edge, c·diagonal across a corner, c·distance_two and c·distance_three to
pixels two and three away along a row or column. Avalanches fired this way do the same. There are no
pixels beyond the edge of the array. Crosstalk light that meets a pixel in its dead time is lost,
and extends a paralyzable one, as any arrival does.

Without dead time the counts are a branching process. With C_ij the probability that an avalanche in
j fires i, means N̄ = λ + C·N̄ for Poisson primaries λ, and the response G = (1 − C)⁻¹,

    Var(N_i) = Σ_j G_ij²·D_j,     D = λ + (C − C∘C)·N̄

for every pixel, including those at the border.

Source: dissertation §2.3.2; Rech et al., Optics Express 16, 8381 (2008) for shares by distance.
"""

from functools import lru_cache
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.ndimage import convolve
from scipy.sparse import csr_matrix, diags, identity

from megalopta.core.arrays import Floats
from megalopta.sensor.effects.base import Effect, PixelRates, Stage

REACH = 3
"""Largest distance of direct crosstalk along a row or column, pixels."""
_NEGLIGIBLE, _SMALL_RESPONSE = 1e-15, 1e-6
_PIXELS_AT_ONCE = 4096

Share = Annotated[float, Field(ge=0, le=1)]


class Crosstalk(Effect, frozen=True):
    """Probabilities that avalanches fire neighboring pixels; off by default."""

    stage: ClassVar[Stage] = Stage.AVALANCHES
    statement: ClassVar[str] = "avalanches send light to neighboring pixels"

    mean_fired_neighbors: Annotated[float, Field(ge=0, le=0.8)] = 0.0
    """Mean number of pixels that one avalanche inside the array fires (0: no crosstalk)."""
    diagonal: Share = 0.0
    """Probability to fire a corner neighbor, relative to an edge neighbor."""
    distance_two: Share = 0.0
    """The same for a pixel two away along a row or column."""
    distance_three: Share = 0.0
    """The same for a pixel three away along a row or column."""
    mismatch_sigma: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Relative standard deviation over the pixels of the number of fired neighbors (log-normal)."""

    @property
    def is_on(self) -> bool:
        """True if any neighbor is fired."""
        return self.mean_fired_neighbors > 0

    def act_on_rates(self, rates: PixelRates) -> None:
        """Apply each pixel's factor on the crosstalk that it sends."""
        if self.is_on:
            rates.scatter("crosstalk", self.mismatch_sigma)


def neighborhood(crosstalk: Crosstalk) -> Floats:
    """Return (7, 7) probabilities that an avalanche in the middle fires each pixel around it."""
    shares = np.zeros((2 * REACH + 1, 2 * REACH + 1))
    at = REACH + np.array([-1, 1])
    shares[np.ix_(at, at)] = crosstalk.diagonal
    for away, share in enumerate((1.0, crosstalk.distance_two, crosstalk.distance_three), 1):
        for step in (-away, away):
            shares[REACH + step, REACH] = shares[REACH, REACH + step] = share
    return np.asarray(shares * (crosstalk.mean_fired_neighbors / shares.sum()))


def spread(
    rng: np.random.Generator,
    primaries: NDArray[np.int64],
    crosstalk: Crosstalk,
    strength: Floats | None = None,
) -> NDArray[np.int64]:
    """Draw the counts of one frame with crosstalk.

    Parameters
    ----------
    rng : numpy.random.Generator
    primaries : (rows, columns) int64
    crosstalk : Crosstalk
    strength : (rows, columns) float64, optional
        Neighbors that a pixel fires, relative to `mean_fired_neighbors`; default: 1.
    """
    if not crosstalk.is_on:
        return primaries
    weights = neighborhood(crosstalk)
    counts, generation = primaries.copy(), primaries
    while generation.any():
        generation = _fired(rng, generation, weights, strength)
        counts += generation
    return counts


def _fired(
    rng: np.random.Generator,
    generation: NDArray[np.int64],
    weights: Floats,
    strength: Floats | None,
) -> NDArray[np.int64]:
    padded = np.zeros(np.add(generation.shape, 2 * REACH), np.int64)
    rows, columns = generation.shape
    scale = 1.0 if strength is None else strength
    for row, column in np.argwhere(weights):
        shifted = padded[row : row + rows, column : column + columns]
        shifted += rng.binomial(generation, np.minimum(weights[row, column] * scale, 1.0))
    return padded[REACH:-REACH, REACH:-REACH]


def fired_mean(counts: Floats, crosstalk: Crosstalk, strength: Floats | None = None) -> Floats:
    """Mean number of avalanches fired in each pixel, from mean counts of its neighbors."""
    sent = counts if strength is None else counts * strength
    return np.asarray(convolve(sent, neighborhood(crosstalk), mode="constant"))


def mean(primaries: Floats, crosstalk: Crosstalk, strength: Floats | None = None) -> Floats:
    """Mean counts of a (rows, columns) frame without dead time, from the mean primaries."""
    total, generation = primaries.copy(), primaries
    while generation.max(initial=0) > _NEGLIGIBLE * total.max(initial=0):
        generation = fired_mean(generation, crosstalk, strength)
        total += generation
    return total


def variance(primaries: Floats, crosstalk: Crosstalk, strength: Floats | None = None) -> Floats:
    """Variance of the counts of a frame without dead time, from mean Poisson primaries."""
    counts = mean(primaries, crosstalk, strength)
    drawn = primaries + fired_mean(counts, crosstalk, strength)
    return spread_variance(drawn, counts, crosstalk, strength)


def spread_variance(
    drawn: Floats,
    counts: Floats,
    crosstalk: Crosstalk,
    strength: Floats | None = None,
    answer: Floats | None = None,
    returns: bool = True,
) -> Floats:
    """Variance of counts that fire, and are fired by, their neighbors.

    Parameters
    ----------
    drawn : (rows, columns) float64
        Variance of each pixel if its neighbors' light were a Poisson process.
    counts : (rows, columns) float64
        Mean counts.
    crosstalk : Crosstalk
    strength : (rows, columns) float64, optional
        As for `spread`.
    answer : (rows, columns) float64, optional
        Counts that a pixel gains per arrival; default: 1.
    returns : bool
        True if light from avalanches that a pixel caused elsewhere may fire it again.
    """
    weights = neighborhood(crosstalk)
    sent = np.ones_like(counts) if strength is None else strength
    gain = np.ones_like(counts) if answer is None else answer
    noise = drawn - gain**2 * convolve(counts * sent**2, weights**2, mode="constant")
    total = np.empty(counts.size)
    matrix = diags(gain.ravel()) @ _matrix(counts.shape, crosstalk) @ diags(sent.ravel())
    for first in range(0, counts.size, _PIXELS_AT_ONCE):
        rows = slice(first, first + _PIXELS_AT_ONCE)
        response = term = identity(counts.size, format="csr")[rows]
        while term.nnz:
            term = term @ matrix
            term.data[term.data < _SMALL_RESPONSE] = 0.0
            term.eliminate_zeros()
            response = response + term
        total[rows] = np.asarray(response.power(2) @ noise.ravel())
        if not returns:  # G_ij is the probability to reach i at all, times G_ii avalanches there
            total[rows] /= response.diagonal(first) ** 2
    return total.reshape(counts.shape)


@lru_cache(maxsize=4)
def _matrix(shape: tuple[int, int], crosstalk: Crosstalk) -> csr_matrix:
    """Probability that an avalanche of each pixel (columns) fires each other one (rows)."""
    weights = neighborhood(crosstalk)
    places = np.indices(shape).reshape(2, -1)
    number = np.arange(places.shape[1])
    to, by, chances = [], [], []
    for offset in np.argwhere(weights):
        row, column = places + offset[:, None] - REACH
        inside = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
        to.append((row * shape[1] + column)[inside])
        by.append(number[inside])
        chances.append(np.full(inside.sum(), weights[tuple(offset)]))
    entries = np.concatenate(chances), (np.concatenate(to), np.concatenate(by))
    return csr_matrix(entries, shape=(number.size, number.size))
