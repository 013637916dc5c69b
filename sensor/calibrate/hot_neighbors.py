"""Crosstalk around hot pixels, from a map of dark counts.

A hot pixel adds a share of its counts to those of its neighbors. So the rate of a pixel is a level
common to all plus shares of the rates around it. They minimize the sum of absolute residuals, which
pixels that are hot themselves hardly affect. Shares are estimated apart for pixels of even and odd
rows and columns: where pixels are laid out in pairs, light reaches the partner more easily.

Rates r are those of dark carriers λ and of all that is fired, r = λ + C·r: a share is the
probability that an avalanche fires a neighbor. Limits: sources are thousands of times as bright
as the rest, so that light and its reflections are seen, but not whether pixels differ.
"""

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Mask, robust_sigma
from megalopta.sensor.effects.crosstalk import REACH, Crosstalk

FEWEST_PIXELS = 4096
"""Pixels that a map needs for an estimate."""
PERIOD = 2
"""Rows and columns after which the layout of pixels may repeat."""
_ROUNDS = 20
_FINEST = 0.02
_SEEN, _CLEAR = 3.0, 4.0
_SIDE = 2 * REACH + 1
_PLACES = np.delete(np.arange(_SIDE**2), _SIDE**2 // 2)


def crosstalk_of_hot_pixels(rates: Floats, use: Mask | None = None) -> Floats:
    """Return shares that pixels receive, (2, 2, 7, 7), by parity of the receiver's row and column.

    [p, q, 3 + down, 3 + right] is the share of the rate of the pixel that is so far down and right.

    Parameters
    ----------
    rates : (rows, columns) float64
        Mean events per frame or second; NaN: not known, as are all pixels that see such a one.
    use : (rows, columns) bool, optional
        Receivers to use; default: all that are three pixels from the border.

    Raises ValueError if there are too few pixels.
    """
    if rates.size < FEWEST_PIXELS:
        raise ValueError(f"{rates.size} pixels; crosstalk of hot pixels needs {FEWEST_PIXELS}")
    inside = np.zeros(rates.shape, np.bool_)
    inside[REACH:-REACH, REACH:-REACH] = True
    if use is not None:
        inside &= use
    found = np.zeros((PERIOD, PERIOD, _SIDE**2))
    for row, column in np.ndindex(PERIOD, PERIOD):
        chosen = np.zeros_like(inside)
        chosen[row::PERIOD, column::PERIOD] = inside[row::PERIOD, column::PERIOD]
        found[row, column, _PLACES] = _shares(rates, np.argwhere(chosen))
    return found.reshape(PERIOD, PERIOD, _SIDE, _SIDE)


def _shares(rates: Floats, places: NDArray[np.int_]) -> Floats:
    """Share that pixels at some places receive from each neighbor: least absolute residuals."""
    down, right = np.divmod(_PLACES, _SIDE)
    around = rates[places[:, :1] + down - REACH, places[:, 1:] + right - REACH]
    received = rates[places[:, 0], places[:, 1]]
    known = np.isfinite(received) & np.isfinite(around).all(axis=1)
    if known.sum() < 4 * len(_PLACES):
        raise ValueError(f"{known.sum()} pixels with all neighbors known; measure more")
    matrix = np.column_stack((np.ones(known.sum()), around[known]))
    level = float(np.median(received[known]))
    solution = np.concatenate(([level], np.zeros(len(_PLACES))))
    for _ in range(_ROUNDS):
        residual = np.abs(received[known] - matrix @ solution)
        weighted = matrix / np.maximum(residual, _FINEST * level)[:, None]
        solution = np.linalg.solve(weighted.T @ matrix, weighted.T @ received[known])
    return np.asarray(solution[1:])


def kernel_of(shares: Floats) -> Crosstalk:
    """Return the crosstalk of senders whose neighbors receive these shares; off if none is seen.

    The scatter of shares three pixels away and farther shows their noise. Shares below four of it
    are left at 0, and all are if those of edge neighbors are below three on average.
    """
    distance = np.hypot(*(np.indices((_SIDE, _SIDE)) - REACH))
    noise = robust_sigma(shares[:, :, distance >= REACH])
    if shares[:, :, distance == 1].mean() < _SEEN * noise:
        return Crosstalk()
    kernel = np.zeros_like(shares)
    for row, column, down, right in np.argwhere(shares > _CLEAR * noise):
        sender = (row + down - REACH) % PERIOD, (column + right - REACH) % PERIOD
        place = _SIDE - 1 - down, _SIDE - 1 - right
        kernel[(*sender, *place)] = shares[row, column, down, right]
    return Crosstalk(mean_fired_neighbors=float(kernel.sum()) / PERIOD**2, kernel=kernel.tolist())
