"""Crosstalk and afterpulsing of an array, from its dark counts: three ways.

**Coincidences** (`neighbor_kernel`). In a wide array in which an avalanche fires a pixel at offset
δ with probability k(δ), Poisson primaries make covariances

    C(δ) = Σ_j G(j)·G(j + δ)·D        G = (1 − k)⁻¹, D = m·(1 − Σ k²)

for mean counts m. Pairs of one offset and its opposite give C(δ)/m, less that of distant pixels
(temperature, stray light), solved for k over offsets up to two pixels. Variance beyond that of
crosstalk is due to afterpulses. With a mean number p of them, all within the exposure, G is
(1 − k − p)⁻¹: covariances and variance are those of k/(1 − p) over (1 − p)². Covariances are kept
by direction and parity of row and column, k(δ) both ways being equal; edge, corner and second
neighbors each have one probability, or where χ² is beyond a chance of 1e-3, one by direction and
then by parity.

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
from scipy.stats import chi2

from megalopta.core.arrays import Floats, Ints, Mask, robust_sigma
from megalopta.core.quantities import with_error
from megalopta.sensor.calibrate.statistics import OFFSETS, Statistics, both
from megalopta.sensor.effects.crosstalk import REACH, Crosstalk, neighborhoods

_FAR, _ALIKE, _SIDE_OF_TORUS = 4, 1e-3, 12
_CLASSES = (slice(0, 2), slice(2, 4), slice(4, 6))
"""Edge, corner and second neighbors of `OFFSETS`, four of each"""
_AXES: tuple[tuple[int, ...], ...] = ((0, 1, 2), (1, 2), (2,), (1,))
"""Averages over directions, and parities of rows and columns, coarsest first"""


class Kernel(NamedTuple):
    """Probabilities that an avalanche fires a neighbor at `OFFSETS`, and that one it, (6, 2, 2).

    By parity of row and column of the former.
    """

    share: Floats
    error: Floats
    """Standard errors."""
    afterpulses: float
    """Mean number of afterpulses within the exposure per avalanche; NaN: unknown."""
    afterpulses_error: float

    @property
    def averaged(self) -> tuple[Floats, list[bool]]:
        """Probabilities, alike where they do not differ significantly (6, 2, 2).

        And True for edge, corner and second neighbors of which all are alike.
        """
        mean, are_alike = np.empty_like(self.share), []
        for part in _CLASSES:
            share, weight = self.share[part], 1 / np.maximum(self.error[part], 1e-15) ** 2
            for axes in (*_AXES, ()):
                average = np.average(share, axes, weight, keepdims=True)
                apart = float((weight * (share - average) ** 2).sum())
                if chi2.sf(apart, share.size - average.size) > _ALIKE:
                    break
            mean[part] = average
            are_alike.append(axes == _AXES[0])
        return mean, are_alike

    @property
    def crosstalk(self) -> Crosstalk:
        """Crosstalk by direction and parity where they differ, else by distance."""
        mean, are_alike = np.maximum(self.averaged[0], 0.0), self.averaged[1]
        total = min(float(2 * mean.mean(axis=(1, 2)).sum()), 0.8)
        if all(are_alike):
            orthogonal, diagonal, two = (float(mean[part].mean()) for part in _CLASSES)
            return Crosstalk(
                mean_fired_neighbors=total,
                diagonal=min(diagonal / orthogonal, 1.0),
                distance_two=min(two / orthogonal, 1.0),
            )
        kernel = np.zeros((PERIOD, PERIOD, 5, 5))
        for (down, right), of_parity in zip(OFFSETS, mean, strict=True):
            for row, column in np.ndindex(PERIOD, PERIOD):
                to = (row + down) % PERIOD, (column + right) % PERIOD
                kernel[row, column, 2 + down, 2 + right] = of_parity[row, column]
                kernel[*to, 2 - down, 2 - right] = of_parity[row, column]
        return Crosstalk(mean_fired_neighbors=total, kernel=kernel.tolist())

    @property
    def is_seen(self) -> bool:
        """True if edge neighbors show crosstalk beyond 3 standard errors, on average or any."""
        share, error = self.share[:2], self.error[:2]
        on_average = share.sum() > 3 * np.sqrt(np.square(error).sum())
        return bool(on_average or (share > 5 * error).any())

    @property
    def seen(self) -> tuple[Crosstalk, float] | None:
        """Crosstalk, and the error of its mean; None if it is not seen."""
        return (self.crosstalk, self.total_error) if self.is_seen else None

    @property
    def total_error(self) -> float:
        """Standard error of the mean number of neighbors that fire a pixel."""
        squares = [
            np.square(self.error[part]).mean() * (2 if is_alike else 4)
            for part, is_alike in zip(_CLASSES, self.averaged[1], strict=True)
        ]
        return float(np.sqrt(np.sum(squares)))

    @property
    def limit(self) -> float:
        """Probability to fire an edge neighbor that is not excluded, 95 %."""
        error = np.sqrt(np.square(self.error[:2]).sum()) / self.error[:2].size
        return float(max(self.share[:2].mean(), 0.0) + 1.645 * error)

    @property
    def are_afterpulses_seen(self) -> bool:
        """True if there are afterpulses beyond 3 standard errors."""
        return self.afterpulses > 3 * self.afterpulses_error


def text_of(talk: tuple[Crosstalk, float]) -> str:
    """Return the mean number of neighbors that an event fires, with the 95 % CI of its error."""
    return with_error(100 * talk[0].mean_fired_neighbors, 196 * talk[1], "%")


def neighbor_kernel(recording: Statistics, good: Mask, *, is_binary: bool = False) -> Kernel:
    """Estimate the kernel from dark counts, of the good pixels (rows, columns).

    Bits do not show afterpulses. Raises ValueError if too few good pixels have neighbors.
    """
    recording = _of_events(recording, good) if is_binary else recording
    mean, variance, n = recording.mean, recording.variance, recording.frames
    pairs = [_pairs(recording, good, at) for at in range(len(OFFSETS))]
    ratios, errors = np.array(pairs).transpose(1, 0, 2, 3)
    # mean covariance of pixels at least four rows apart
    of_rows = recording.of_rows - recording.of_rows.mean(axis=0)
    far = np.triu(of_rows.T @ of_rows / (n - 1), _FAR)
    distant = np.triu(np.ones(far.shape), _FAR).sum()
    common = float(far.sum() / max(distant, 1) / mean[good].mean())
    seen, error = ratios - common, errors / 2
    m = mean[good]
    # Poisson variance, not the observed one: otherwise counts of small variance would weigh more
    weight = 1 / (2 * m + 1)
    fano = float((weight * variance[good]).sum() / (weight * m).sum()) - common
    spread = 1 / np.sqrt(n * (weight * m).sum())
    left = 1.0  # 1 − p
    for _ in range(3):
        # the kernel that produces the observed covariances
        target = seen * left**2
        relative = target / 2
        for _ in range(20):
            response, spread_by_talk = _response(relative)
            change = (response - target) / 2
            relative = relative - change
            total = 2 * np.abs(relative).mean(axis=(1, 2)).sum()
            if total > 0.8:
                relative *= 0.8 / total
            if np.abs(change).max() < 1e-7:
                break
        if is_binary:
            return Kernel(relative, error, np.nan, np.nan)
        left = max(fano / spread_by_talk, 1e-9) ** -0.5
    return Kernel(relative * left, error * left**3, float(1 - left), float(0.5 * spread * left**3))


def _of_events(bits: Statistics, good: Mask) -> Statistics:
    """Statistics of the events that make bits 1.

    With λ and μ events, crosstalk k and none of both bits in a share Q of frames, of P and R alone,
    ln(Q/PR) = k (λ + μ), which is the covariance of events.
    """
    none = np.where(good, 1 - bits.mean, 1.0).clip(1 / bits.frames)
    covariances = np.zeros_like(bits.neighbors)
    for covariance, seen, offset in zip(covariances, bits.neighbors, OFFSETS, strict=True):
        first, second = both(offset)
        share = none[first] * none[second]
        covariance[first] = np.log(np.maximum(1 + seen[first] / share, 0.1))
    mean = -np.log(none)
    # a covariance of bits is less certain than one of events
    frames = bits.frames * float((mean[good].sum() / (1 / none - 1)[good].sum()) ** 2)
    of_rows = bits.of_rows / none[good].mean()
    return bits._replace(mean=mean, neighbors=covariances, frames=int(frames), of_rows=of_rows)


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


def _pairs(recording: Statistics, good: Mask, at: int) -> tuple[Floats, Floats]:
    """Covariance over mean of all pairs of an offset, weighted by light; standard error; (2, 2)."""
    first, second = both(OFFSETS[at])
    mean, covariance = recording.mean, recording.neighbors[at][first]
    # brighter pairs are more precise per event: weight by inverse variance of the ratio
    total = (mean[first] + mean[second]) / 2
    noise = mean[first] * mean[second] / recording.frames
    is_good = good[first] & good[second] & (noise > 0)
    weight = np.divide(total, noise, out=np.zeros_like(noise), where=is_good)
    ratio, error = np.empty((2, PERIOD, PERIOD))
    row, column = first[0].start or 0, first[1].start or 0
    for parity in np.ndindex(PERIOD, PERIOD):
        some = slice((parity[0] - row) % 2, None, 2), slice((parity[1] - column) % 2, None, 2)
        norm = (weight[some] * total[some]).sum()
        if is_good[some].sum() < 2 or not norm > 0:
            raise ValueError("crosstalk: too few good pixels side by side; it cannot be estimated")
        ratio[parity] = (weight[some] * covariance[some]).sum() / norm
        error[parity] = np.sqrt((weight[some] ** 2 * noise[some]).sum()) / norm
    return ratio, error


def _response(share: Floats) -> tuple[Floats, float]:
    """Covariance over mean, by offset and parity, and variance over mean, in an unbounded array."""
    side = _SIDE_OF_TORUS
    rows, columns = np.indices((side, side))
    number, kernel = rows * side + columns, np.zeros((side**2, side**2))
    neighbors = [(rows + down) % side * side + (columns + right) % side for down, right in OFFSETS]
    for neighbor, of_parity in zip(neighbors, share, strict=True):
        probability = np.tile(of_parity, (side // PERIOD, side // PERIOD))
        kernel[number, neighbor] += probability
        kernel[neighbor, number] += probability
    response = np.linalg.inv(np.identity(side**2) - kernel)
    covariance = (response * (1 - np.square(kernel).sum(axis=0))) @ response.T
    of_offsets = [covariance[number, neighbor][:PERIOD, :PERIOD] for neighbor in neighbors]
    return np.array(of_offsets), float(np.diagonal(covariance).mean())


FEWEST_PIXELS = 4096
"""Pixels that a map needs for an estimate."""
PERIOD = 2
"""Rows and columns after which the layout of pixels may repeat."""
_SIDE = 2 * REACH + 1
_PLACES = np.delete(np.arange(_SIDE**2), _SIDE**2 // 2)


def crosstalk_of_hot_pixels(rates: Floats) -> Floats:
    """Return shares that pixels receive, (2, 2, 7, 7), by parity of the receiver's row and column.

    [p, q, 3 + down, 3 + right] is the share of the rate of the pixel that is so far down and right.
    `rates` (rows, columns) are mean events per frame or second; NaN: not known, as are all pixels
    that see such a one. Raises ValueError if there are too few pixels.
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


def kernel_of(shares: Floats) -> tuple[Crosstalk, float]:
    """Return the crosstalk of senders whose neighbors receive these shares, and a share's error.

    Off if none is seen.

    The scatter of shares three pixels away and farther shows their noise. Shares below four of it
    are left at 0, and all are if those of edge neighbors are below three on average.
    """
    distance = np.hypot(*(np.indices((_SIDE, _SIDE)) - REACH))
    noise = robust_sigma(shares[:, :, distance >= REACH])
    if shares[:, :, distance == 1].mean() < 3.0 * noise:
        return Crosstalk(), noise
    kernel = np.zeros_like(shares)
    for row, column, down, right in np.argwhere(shares > 4.0 * noise):
        sender = (row + down - REACH) % PERIOD, (column + right - REACH) % PERIOD
        place = _SIDE - 1 - down, _SIDE - 1 - right
        kernel[(*sender, *place)] = shares[row, column, down, right]
    total = float(kernel.sum()) / PERIOD**2
    return Crosstalk(mean_fired_neighbors=total, kernel=kernel.tolist()), noise


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


def fit_crosstalk(pairs: PairCrosstalk) -> Crosstalk:
    """Return crosstalk with the mean probability of the pairs at each distance.

    Raises ValueError without pairs of edge neighbors, or if these show no crosstalk.
    """
    probabilities = []
    for offsets in (((0, 1), (1, 0)), ((1, 1),), ((0, 2), (2, 0)), ((0, 3), (3, 0))):
        are_at = ((pairs.down == down) & (pairs.right == right) for down, right in offsets)
        values = np.concatenate([pairs.probability[is_at] for is_at in are_at])
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
