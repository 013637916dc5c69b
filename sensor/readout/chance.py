"""Chance that at least one of a Poisson number of events comes, fast and to a known error.

1 − e^(−m) for m up to 16, 1 beyond: e^(−m/16) by a polynomial of degree 6, squared four times. No
branch and no table, so that a loop over pixels becomes vector instructions in single precision.
"""

import numpy as np
from numba import njit

CHANCE_ERROR = 2e-6
"""Bound of the error of `chance`; found 1.2e-6."""

_LARGEST_MEAN = np.float32(16)

# Of e^(−y), 0 ≤ y ≤ 1, the largest error made least: 3e-8 in exact arithmetic.
_C = np.polynomial.chebyshev.Chebyshev.interpolate(lambda y: np.exp(-y), 6, [0, 1])
_C0, _C1, _C2, _C3, _C4, _C5, _C6 = map(np.float32, _C.convert(kind=np.polynomial.Polynomial).coef)


@njit(cache=True, nogil=True, inline="always")  # type: ignore[untyped-decorator]
def chance(mean: np.float32) -> np.float32:
    """Chance of one or more of `mean` events on average, with an error below `CHANCE_ERROR`.

    Parameters
    ----------
    mean : float32
        Not negative.
    """
    y = min(mean, _LARGEST_MEAN) * np.float32(1 / 16)
    e = _C0 + y * (_C1 + y * (_C2 + y * (_C3 + y * (_C4 + y * (_C5 + y * _C6)))))
    e *= e
    e *= e
    e *= e
    e *= e
    return np.float32(1) - e
