"""Types of arrays, spread, look-up, levels. Every folder may import this module."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


def robust_sigma(apart: Floats) -> float:
    """Return the standard deviation of normal differences from their center, by the median."""
    return 1.4826 * float(np.median(np.abs(apart)))


def mean_and_variance(frames: NDArray[Any]) -> tuple[Floats, Floats]:
    """Return the mean and variance (n − 1) over frames (n, …), without a copy of all of them."""
    mean = frames.mean(axis=0, dtype=np.float64)
    squares = np.zeros(mean.shape)
    for frame in frames:
        squares += np.square(frame - mean)
    return mean, squares / (len(frames) - 1)


def bilinear(picture: NDArray[Any], x: NDArray[Any], y: NDArray[Any]) -> NDArray[Any]:
    """Values (..., C) of a picture (H, W) or (H, W, C), which repeats, at columns and rows (...).

    0 is the center of the first pixel.
    """
    image = picture.reshape(*picture.shape[:2], -1)
    rows, columns = image.shape[:2]
    left, top = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    right, down = (x - left)[..., None], (y - top)[..., None]
    across = left % columns, (left + 1) % columns
    upper, lower = (
        (1 - right) * image[row, across[0]] + right * image[row, across[1]]
        for row in (top % rows, (top + 1) % rows)
    )
    return np.asarray((1 - down) * upper + down * lower)


def first_reached(places: Sequence[float] | Floats, errors: Floats, target: float) -> float | None:
    """Return the first place where errors are at a target, between the places; None if never."""
    reached = np.flatnonzero(errors <= target)
    if not reached.size:
        return None
    place = int(reached[0])
    if place == 0 or not np.isfinite(errors[place - 1]):
        return float(places[place])
    around = slice(place - 1, place + 1)
    return math.exp(np.interp(-math.log(target), -np.log(errors[around]), np.log(places[around])))
