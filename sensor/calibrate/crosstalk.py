"""Crosstalk and afterpulsing of an array, from its dark counts: three ways.

**Coincidences** (`neighbor_kernel`). In a wide array in which an avalanche fires a pixel at offset
δ with probability k(δ), Poisson primaries make covariances

    C(δ) = Σ_j G(j)·G(j + δ)·D        G = (1 − k)⁻¹, D = m·(1 − Σ k²)

for mean counts m. Pairs of one offset and its opposite give C(δ)/m, less that of distant pixels
(temperature, stray light), solved for k over offsets up to two pixels. Variance beyond that of
crosstalk is due to afterpulses. With a mean number p of them, all within the exposure, G is
(1 − k − p)⁻¹: covariances and variance are those of k/(1 − p) over (1 − p)².

**Hot pixels** (`crosstalk_of_hot_pixels`). The rate of a pixel is a level common to all plus shares
of the rates around it. They minimize the sum of absolute residuals, which pixels that are hot
themselves hardly affect. Where pixels are laid out in pairs, light reaches the partner more easily:
shares are estimated apart for pixels of even and odd rows and columns. Rates r are those of dark
carriers λ and of all that is fired, r = λ + C·r: a share is the probability that an avalanche fires
a neighbor.

**Pairs** (`fit_crosstalk`): measured probabilities that an avalanche in one of two pixels fires the
other; their mean at each distance, not weighted, as pairs differ by more than counting errors.

Source: coincidences, Restelli et al., Proc. SPIE 6372 (2006); the branching process, as in
`sensor/effects/crosstalk.py`.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Ints, Mask, robust_sigma
from megalopta.sensor.effects.crosstalk import REACH, Crosstalk, neighborhoods

OFFSETS = ((0, 1), (1, 0), (1, 1), (1, -1), (0, 2), (2, 0))
_FAR = 4
_SIZE = 32


class Kernel(NamedTuple):
    """Probabilities that an avalanche fires a pixel at each of `OFFSETS` or its opposite."""

    share: Floats
    error: Floats
    """Standard errors."""
    afterpulses: float
    """Mean number of afterpulses within the exposure per avalanche; NaN: unknown."""
    afterpulses_error: float

    @property
    def is_seen(self) -> bool:
        """True if the nearest neighbors show crosstalk beyond 3 standard errors."""
        nearest = self.share[:2].sum()
        return bool(nearest > 3 * np.sqrt(np.square(self.error[:2]).sum()))

    @property
    def echoes(self) -> tuple[float, float]:
        """Events that an avalanche causes, by crosstalk and afterpulses, and their standard error.

        What is not seen is taken as 0; an estimate of afterpulses is then part of the error.
        """
        fired, error = 0.0, self.afterpulses_error
        if self.is_seen:
            fired, error = 2 * float(self.share.sum()), float(np.hypot(error, self.total_error))
        if self.are_afterpulses_seen:
            return fired + self.afterpulses, error
        return fired, float(np.hypot(error, max(self.afterpulses, 0.0)))

    @property
    def total_error(self) -> float:
        """Standard error of the mean number of fired neighbors."""
        return 2 * float(np.sqrt(np.square(self.error).sum()))  # each offset in both directions

    @property
    def are_afterpulses_seen(self) -> bool:
        """True if there are afterpulses beyond 3 standard errors."""
        return self.afterpulses > 3 * self.afterpulses_error


def neighbor_kernel(counts: NDArray[Any], good: Mask) -> Kernel:
    """Estimate the kernel from dark counts (n, rows, columns) of the good pixels (rows, columns).

    Raises ValueError if too few good pixels have neighbors.
    """
    counts = np.asarray(counts, np.float64)
    mean = counts.mean(axis=0)
    n = len(counts)
    excess = np.where(good, counts - mean, 0)
    variance = np.where(good, counts.var(axis=0, ddof=1), 0)
    ratios, errors = np.array([_pairs(excess, mean, good, offset) for offset in OFFSETS]).T
    # mean covariance of pixels at least four rows apart
    sums, pairs = 0.0, 0
    rows = good.shape[0]
    totals, numbers = excess.sum(axis=2), good.sum(axis=1)
    for row in range(rows - _FAR):
        below = totals[:, row + _FAR :].sum(axis=1)
        sums += float((totals[:, row] * below).sum()) / (n - 1)
        pairs += int(numbers[row] * numbers[row + _FAR :].sum())
    common = (sums / pairs if pairs else 0.0) / float(mean[good].mean())
    seen, error = ratios - common, errors / 2
    m = mean[good]
    # Poisson variance, not the observed one: otherwise counts of small variance would weigh more
    weight = 1 / (2 * m + 1)
    fano = float((weight * variance[good]).sum() / (weight * m).sum()) - common
    spread = 1 / np.sqrt(n * (weight * m).sum())
    left = 1.0  # 1 − p
    for _ in range(4):
        # the kernel that produces the observed covariances
        target = seen * left**2
        relative = target / 2
        for _ in range(60):
            response = _response(relative)
            relative = relative - (np.array([response[place] for place in OFFSETS]) - target) / 2
            total = 2 * np.abs(relative).sum()
            if total > 0.8:
                relative *= 0.8 / total
        left = max(fano / _response(relative)[0, 0], 1e-9) ** -0.5
    return Kernel(relative * left, error * left**3, float(1 - left), float(0.5 * spread * left**3))


def mean_kernel(kernels: Sequence[Kernel]) -> Kernel:
    """Average kernels of independent recordings by their precision."""

    def averaged(values: str, errors: str) -> tuple[Any, Any]:
        squares = np.square([getattr(kernel, errors) for kernel in kernels])
        weights = 1 / np.maximum(squares, 1e-30)
        total = weights.sum(axis=0)
        mean = (weights * np.array([getattr(kernel, values) for kernel in kernels])).sum(axis=0)
        return mean / total, 1 / np.sqrt(total)

    afterpulses = map(float, averaged("afterpulses", "afterpulses_error"))
    return Kernel(*averaged("share", "error"), *afterpulses)


def _pairs(
    excess: Floats, mean: Floats, good: Mask, offset: tuple[int, int]
) -> tuple[float, float]:
    """Covariance over mean of all pairs of an offset, weighted by light; standard error."""
    (down, right), (rows, columns) = offset, good.shape
    left = slice(max(-right, 0), columns - max(right, 0))
    first, second = (
        (slice(0, rows - down), left),
        (slice(down, rows), slice(left.start + right, left.stop + right)),
    )
    both = good[first] & good[second]
    covariance = (excess[:, *first] * excess[:, *second]).sum(axis=0) / (len(excess) - 1)
    # brighter pairs are more precise per event: weight by inverse variance of the ratio
    total = (mean[first] + mean[second]) / 2
    noise = mean[first] * mean[second] / len(excess)
    weight = np.where(both & (noise > 0), total / np.where(noise > 0, noise, 1), 0)
    norm = float((weight * total).sum())
    if both.sum() < 2 or not norm > 0:
        raise ValueError("crosstalk: too few good pixels side by side; it cannot be estimated")
    error = float(np.sqrt((weight**2 * noise).sum())) / norm
    return float((weight * covariance).sum()) / norm, error


def _response(share: Floats) -> Floats:
    """Covariance over mean, by offset, in an unbounded array."""
    kernel = np.zeros((_SIZE, _SIZE))
    for (down, right), probability in zip(OFFSETS, share, strict=True):
        kernel[down % _SIZE, right % _SIZE] += probability
        kernel[-down % _SIZE, -right % _SIZE] += probability
    transform = np.abs(1 / (1 - np.fft.fft2(kernel))) ** 2
    return np.asarray(np.fft.ifft2(transform).real * (1 - np.square(kernel).sum()))


FEWEST_PIXELS = 4096
"""Pixels that a map needs for an estimate."""
PERIOD = 2
"""Rows and columns after which the layout of pixels may repeat."""
_SIDE = 2 * REACH + 1
_PLACES = np.delete(np.arange(_SIDE**2), _SIDE**2 // 2)


def crosstalk_of_hot_pixels(rates: Floats) -> Floats:
    """Return shares that pixels receive, (2, 2, 7, 7), by parity of the receiver's row and column.

    [p, q, 3 + down, 3 + right] is the share of the rate of the pixel that is so far down and right.

    Parameters
    ----------
    rates : (rows, columns) float64
        Mean events per frame or second; NaN: not known, as are all pixels that see such a one.

    Raises ValueError if there are too few pixels.
    """
    if rates.size < FEWEST_PIXELS:
        raise ValueError(f"{rates.size} pixels; crosstalk of hot pixels needs {FEWEST_PIXELS}")
    inside = np.zeros(rates.shape, np.bool_)
    inside[REACH:-REACH, REACH:-REACH] = True
    shares = np.zeros((PERIOD, PERIOD, _SIDE**2))
    for row, column in np.ndindex(PERIOD, PERIOD):
        places = np.argwhere(inside[row::PERIOD, column::PERIOD]) * PERIOD + (row, column)
        down, right = np.divmod(_PLACES, _SIDE)
        around = rates[places[:, :1] + down - REACH, places[:, 1:] + right - REACH]
        received = rates[places[:, 0], places[:, 1]]
        known = np.isfinite(received) & np.isfinite(around).all(axis=1)
        if known.sum() < 4 * len(_PLACES):
            raise ValueError(f"{known.sum()} pixels with all neighbors known; measure more")
        matrix = np.column_stack((np.ones(known.sum()), around[known]))
        typical = float(np.median(received[known]))
        solution = np.concatenate(([typical], np.zeros(len(_PLACES))))
        for _ in range(20):
            residual = np.abs(received[known] - matrix @ solution)
            weighted = matrix / np.maximum(residual, 0.02 * typical)[:, None]
            solution = np.linalg.solve(weighted.T @ matrix, weighted.T @ received[known])
        shares[row, column, _PLACES] = solution[1:]
    return shares.reshape(PERIOD, PERIOD, _SIDE, _SIDE)


def kernel_of(shares: Floats) -> Crosstalk:
    """Return the crosstalk of senders whose neighbors receive these shares; off if none is seen.

    The scatter of shares three pixels away and farther shows their noise. Shares below four of it
    are left at 0, and all are if those of edge neighbors are below three on average.
    """
    distance = np.hypot(*(np.indices((_SIDE, _SIDE)) - REACH))
    noise = robust_sigma(shares[:, :, distance >= REACH])
    if shares[:, :, distance == 1].mean() < 3.0 * noise:
        return Crosstalk()
    kernel = np.zeros_like(shares)
    for row, column, down, right in np.argwhere(shares > 4.0 * noise):
        sender = (row + down - REACH) % PERIOD, (column + right - REACH) % PERIOD
        place = _SIDE - 1 - down, _SIDE - 1 - right
        kernel[(*sender, *place)] = shares[row, column, down, right]
    return Crosstalk(mean_fired_neighbors=float(kernel.sum()) / PERIOD**2, kernel=kernel.tolist())


class PairCrosstalk(NamedTuple):
    """Crosstalk of pairs of pixels, each (M,)."""

    down: Ints
    """Distance in rows, without sign"""
    right: Ints
    column: Floats
    """Mean column of both pixels"""
    probability: Floats
    error: Floats

    def some(self, chosen: Mask) -> "PairCrosstalk":
        """Return a part of the pairs."""
        return PairCrosstalk._make(values[chosen] for values in self)

    def at(self, down: int, right: int) -> "PairCrosstalk":
        """Return the pairs at a distance."""
        return self.some((self.down == down) & (self.right == right))


def fit_crosstalk(pairs: PairCrosstalk) -> Crosstalk:
    """Return crosstalk with the mean probability of the pairs at each distance.

    Raises ValueError without pairs of edge neighbors, or if these show no crosstalk.
    """
    probabilities = []
    for offsets in (((0, 1), (1, 0)), ((1, 1),), ((0, 2), (2, 0)), ((0, 3), (3, 0))):
        values = np.concatenate([pairs.at(*offset).probability for offset in offsets])
        probabilities.append(float(values.mean()) if values.size else 0.0)
    edge = probabilities[0]
    if not edge > 0:
        raise ValueError("no crosstalk between edge neighbors; give pairs at a distance of 1")
    shares = [float(np.clip(probability / edge, 0, 1)) for probability in probabilities[1:]]
    return Crosstalk(
        mean_fired_neighbors=4 * edge * (1 + sum(shares)),
        diagonal=shares[0],
        distance_two=shares[1],
        distance_three=shares[2],
    )


def modelled(crosstalk: Crosstalk, pairs: PairCrosstalk) -> Floats:
    """Return the probability that the model gives each pair."""
    weights = neighborhoods(crosstalk).mean(axis=(0, 1))
    # which way a pair lies is not known
    weights = (weights + weights[::-1] + weights[:, ::-1] + weights[::-1, ::-1]) / 4
    rows, columns = (side // 2 for side in weights.shape)
    within = (pairs.down <= rows) & (pairs.right <= columns)
    down, right = np.where(within, pairs.down, 0), np.where(within, pairs.right, 0)
    return np.asarray(weights[rows + down, columns + right])
