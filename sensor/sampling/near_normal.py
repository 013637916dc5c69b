"""Poisson counts of large means, from normal numbers.

A normal number z becomes the nearest integer n to its quantile of Cornish and Fisher,

    y(z) = m + √m·z + (z² − 1)/6 + (z − z³)/(72·√m)

and is accepted with a chance proportional to √m·P(n)·y′(z)/φ(z), which from a mean of 1024 on and
for |z| < 8 lies between √m − |z|/2 − 0.3 and √m + 4.6: it need seldom be evaluated. Beyond, where
it may be more, a draw comes once in 10¹⁵.
"""

import math

import numpy as np
from numba import njit

_LOW, _HIGH = 0.3, 4.6
"""Of the bounds above; 0.2 and 4.52 are found at a mean of 1024, less at larger ones."""


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def is_accepted(n: int, mean: float, z: float, share: float) -> bool:
    """Whether a count is one of this share, within (0, 1), of those that are kept."""
    sigma = math.sqrt(mean)
    chance = share * (sigma + _HIGH)
    return chance <= sigma - _LOW - abs(z) / 2 or chance <= acceptance(n, mean, z)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def near_normal(rng: np.random.Generator, mean: float) -> int:
    """Draw a count."""
    while True:
        z = rng.standard_normal()
        n = near_normal_count(z, mean)
        if is_accepted(n, mean, z, rng.random()):
            return int(n)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def near_normal_count(z: float, mean: float) -> int:
    """Return the integer nearest to the quantile of a normal number."""
    sigma = math.sqrt(mean)
    quantile = mean + sigma * z + (z * z - 1) / 6 + (z - z**3) / (72 * sigma)
    return math.floor(quantile + 0.5)


@njit(cache=True, nogil=True, error_model="numpy")  # type: ignore[untyped-decorator]
def acceptance(n: float, mean: float, z: float) -> float:
    """√m·P(n)·y′(z)/φ(z), with Stirling's series for the factorial."""
    sigma, d = math.sqrt(mean), (mean - n) / n
    log = n * (math.log1p(d) - d) - (1 - 1 / (30 * n * n)) / (12 * n) + z * z / 2
    return math.exp(log) * math.sqrt(mean / n) * (sigma + z / 3 + (1 - 3 * z * z) / (72 * sigma))
