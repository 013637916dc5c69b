"""Crosstalk: an avalanche emits light that may fire its neighbors.

Crosstalk light that meets a pixel in its dead time is lost, and extends a paralyzable one, as any
arrival does. There are no pixels beyond the edge of the array. Limits: `docs/theory/avalanches.md`.

Without dead time the counts are a branching process. With C_ij the probability that an avalanche in
j fires i, means N̄ = λ + C·N̄ for Poisson primaries λ, and the response G = (1 − C)⁻¹,

    Var(N_i) = Σ_j G_ij²·D_j,     D = λ + (C − C∘C)·N̄

for every pixel, including those at the border.

**First event.** A pixel that has not fired yet lacks light that its own avalanches bring back from
its neighbors. It fires in an exposure with the probability 1 − exp(−Λ_i),

    Λ = λ + C·N̄ − diag(C²)·N̄

This neglects ways back over more pixels, and that neighbors may be dead: 0.2 % of the mean at 0.3
fired neighbors, 2 % at 0.6.

Source: dissertation §2.3.2; Rech et al., Optics Express 16, 8381 (2008) for shares by distance.
"""

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator
from scipy.ndimage import convolve
from scipy.sparse import csr_matrix, diags, identity

from megalopta.core.arrays import Floats, Ints
from megalopta.core.bounded import file_content, named_path, plain_array
from megalopta.sensor.effects.base import Effect

REACH = 3
"""Largest distance of direct crosstalk along a row or column, pixels."""
_NEGLIGIBLE, _SMALL_RESPONSE = 1e-15, 1e-6
_PIXELS_AT_ONCE = 4096
_MOST_FIRED = 0.95
_MOST_NUMBERS = 2**16

Share = Annotated[float, Field(ge=0, le=1)]
Weight = Annotated[float, Field(ge=0, le=1e9)]
Kernels = tuple[tuple[tuple[tuple[Weight, ...], ...], ...], ...]


class Crosstalk(Effect, frozen=True):
    """Probabilities that avalanches fire neighboring pixels; off by default."""

    switch: ClassVar[str] = "mean_fired_neighbors"

    mean_fired_neighbors: Annotated[float, Field(ge=0, le=0.8)] = 0.0
    """Mean number of pixels that one avalanche inside the array fires (0: no crosstalk)."""
    diagonal: Share = 0.0
    """Probability to fire a corner neighbor, relative to an edge neighbor."""
    distance_two: Share = 0.0
    """Probability to fire a pixel two away along a row or column, relative to an edge neighbor."""
    distance_three: Share = 0.0
    """Probability to fire a pixel three away along a row or column, relative to an edge
    neighbor."""
    kernel: Kernels = Field(default=(), exclude_if=lambda kernel: not kernel)
    """Relative probabilities (P, Q, rows, columns) to fire the pixels around, instead of the shares
    above. Entry (p, q), with the pixel itself in the middle, holds for rows p modulo P and columns
    q modulo Q. In a device's file also `{path: FILE.npy}`; empty: the shares."""
    mismatch_sigma: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Relative standard deviation over the pixels of the number of fired neighbors (log-normal)."""

    @model_validator(mode="after")
    def _check_kernel(self) -> Self:
        if not self.kernel:
            return self
        if self.diagonal or self.distance_two or self.distance_three:
            raise ValueError(
                "crosstalk: kernel and shares by distance exclude each other; omit one"
            )
        try:
            weights = np.array(self.kernel)
        except ValueError:  # lists of different lengths
            weights = np.empty(0)
        rows, columns = weights.shape[2:] if weights.ndim == 4 else (0, 0)
        has_middle = rows % 2 and columns % 2 and weights.any() and weights.size <= _MOST_NUMBERS
        if not has_middle or weights[:, :, rows // 2, columns // 2].any():
            raise ValueError(
                f"crosstalk.kernel: shape {weights.shape}; give (P, Q, rows, columns) numbers, "
                f"{_MOST_NUMBERS} at most and not all 0, around a pixel: of odd rows and columns "
                "with 0 in the middle"
            )
        if self.most_fired > _MOST_FIRED:
            raise ValueError(
                f"crosstalk.kernel: {self.most_fired:.3g} pixels fired by some; at most "
                f"{_MOST_FIRED:g}; lower mean_fired_neighbors"
            )
        return self

    @property
    def most_fired(self) -> float:
        """Mean number of pixels fired by an avalanche in the pixel that fires most."""
        return float(neighborhoods(self).sum(axis=(2, 3)).max())


@lru_cache(maxsize=16)
def neighborhoods(crosstalk: Crosstalk) -> Floats:
    """Return probabilities (P, Q, rows, columns) that an avalanche in the middle fires each pixel.

    [p, q] is that of pixels whose row is p modulo P and whose column is q modulo Q. Without a
    `kernel` (1, 1, 7, 7).
    """
    if crosstalk.kernel:
        weights: Floats = np.array(crosstalk.kernel, np.float64)
        scale = weights.shape[0] * weights.shape[1] / weights.sum()
        weights *= crosstalk.mean_fired_neighbors * scale
        weights.flags.writeable = False
        return weights
    shares = np.zeros((2 * REACH + 1, 2 * REACH + 1))
    at = REACH + np.array([-1, 1])
    shares[np.ix_(at, at)] = crosstalk.diagonal
    for away, share in enumerate((1.0, crosstalk.distance_two, crosstalk.distance_three), 1):
        for step in (-away, away):
            shares[REACH + step, REACH] = shares[REACH, REACH + step] = share
    weights = (shares * (crosstalk.mean_fired_neighbors / shares.sum()))[None, None]
    weights.flags.writeable = False
    return weights


def of_pixels(weights: Floats, shape: tuple[int, int]) -> Floats | float:
    """Return a value (P, Q) of the neighborhoods for each pixel; a number if all are alike."""
    if weights.size == 1:
        return float(weights[0, 0])
    rows, columns = shape
    repeats = -(-rows // weights.shape[0]), -(-columns // weights.shape[1])
    return np.asarray(np.tile(weights, repeats)[:rows, :columns])


def spread(
    rng: np.random.Generator, primaries: Ints, crosstalk: Crosstalk, strength: Floats | None = None
) -> Ints:
    """Draw the counts of one frame with crosstalk.

    Parameters
    ----------
    primaries : (rows, columns) int64
    strength : (rows, columns) float64, optional
        Neighbors that a pixel fires, relative to `mean_fired_neighbors`; default: 1.
    """
    if not crosstalk.is_on:
        return primaries
    weights = neighborhoods(crosstalk)
    counts, generation = primaries.copy(), primaries
    while generation.any():
        reach = np.array(weights.shape[2:]) // 2
        padded = np.zeros(np.add(generation.shape, 2 * reach), np.int64)
        rows, columns = generation.shape
        scale = 1.0 if strength is None else strength
        for row, column in places_fired(weights):
            shifted = padded[row : row + rows, column : column + columns]
            chance = of_pixels(weights[:, :, row, column], (rows, columns)) * scale
            shifted += rng.binomial(generation, np.minimum(chance, 1.0))
        down, right = reach
        generation = padded[down : down + rows, right : right + columns]
        counts += generation
    return counts


def places_fired(weights: Floats) -> Ints:
    """Return row and column in the neighborhoods, (n, 2), of pixels that may be fired."""
    return np.argwhere(weights.any(axis=(0, 1)))


def fired_mean(counts: Floats, crosstalk: Crosstalk, strength: Floats | None = None) -> Floats:
    """Mean number of avalanches fired in each pixel, from mean counts of its neighbors."""
    sent = counts if strength is None else counts * strength
    return _received(sent, neighborhoods(crosstalk))


def first_arrivals(
    arrivals: Floats, counts: Floats, crosstalk: Crosstalk, strength: Floats | None = None
) -> Floats:
    """Mean arrivals Λ in a pixel that has not fired, from those without crosstalk and counts."""
    if not crosstalk.is_on:
        return arrivals
    sent = np.ones_like(counts) if strength is None else strength
    chances = _matrix(counts.shape, crosstalk) @ diags(sent.ravel())
    returned = np.asarray(chances.multiply(chances.T).sum(axis=1)).reshape(counts.shape) * counts
    return arrivals + fired_mean(counts, crosstalk, strength) - returned


def _received(sent: Floats, weights: Floats) -> Floats:
    """Sum of what neighbors send, weighted."""
    if weights.shape[:2] == (1, 1):
        return np.asarray(convolve(sent, weights[0, 0], mode="constant"))
    total, (rows, columns) = np.zeros_like(sent), weights.shape[:2]
    for row, column in np.ndindex(rows, columns):
        alike = np.zeros_like(sent)
        alike[row::rows, column::columns] = sent[row::rows, column::columns]
        total += convolve(alike, weights[row, column], mode="constant")
    return total


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
    gain: Floats | None = None,
    returns: bool = True,
) -> Floats:
    """Variance of counts that fire, and are fired by, their neighbors.

    Parameters
    ----------
    drawn : (rows, columns) float64
        Variance of each pixel if its neighbors' light were a Poisson process.
    counts : (rows, columns) float64
        Mean counts.
    strength : (rows, columns) float64, optional
        As for `spread`.
    gain : (rows, columns) float64, optional
        Counts that a pixel gains per arrival; default: 1.
    returns : bool
        True if light from avalanches that a pixel caused elsewhere may fire it again.
    """
    weights = neighborhoods(crosstalk)
    sent = np.ones_like(counts) if strength is None else strength
    gain = np.ones_like(counts) if gain is None else gain
    noise = drawn - gain**2 * _received(counts * sent**2, weights**2)
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
    weights = neighborhoods(crosstalk)
    reach = np.array(weights.shape[2:]) // 2
    places = np.indices(shape).reshape(2, -1)
    number = np.arange(places.shape[1])
    to, by, chances = [], [], []
    for offset in places_fired(weights):
        row, column = places + (offset - reach)[:, None]
        inside = (row >= 0) & (row < shape[0]) & (column >= 0) & (column < shape[1])
        to.append((row * shape[1] + column)[inside])
        by.append(number[inside])
        chance = of_pixels(weights[:, :, offset[0], offset[1]], shape)
        chances.append(np.broadcast_to(chance, shape).ravel()[inside])
    entries = np.concatenate(chances), (np.concatenate(to), np.concatenate(by))
    return csr_matrix(entries, shape=(number.size, number.size))


def with_kernel(crosstalk: Any, folder: Path | None) -> Any:
    """Return crosstalk with the numbers of its kernel's file, (P, Q, rows, columns) or two last.

    Raises ValueError if the file cannot be read or holds no numbers.
    """
    if not isinstance(crosstalk, Mapping) or not isinstance(crosstalk.get("kernel"), Mapping):
        return crosstalk
    path = crosstalk["kernel"].get("path")
    if not isinstance(path, str) or len(crosstalk["kernel"]) > 1:
        raise ValueError("crosstalk.kernel: give numbers, or path alone, of a .npy file")
    weights = plain_array(file_content(named_path(path, folder), "crosstalk.kernel"))
    if weights is None or weights.size > _MOST_NUMBERS:
        raise ValueError(
            f"crosstalk.kernel: {path} does not hold {_MOST_NUMBERS} plain numbers or fewer; write "
            "it with numpy.save"
        )
    weights = weights[None, None] if weights.ndim == 2 else weights
    return {**crosstalk, "kernel": weights.tolist()}
