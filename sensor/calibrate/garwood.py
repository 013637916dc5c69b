"""Exact intervals of a Poisson mean.

Source: F. Garwood, Biometrika 28, 437 (1936).
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import chi2

from megalopta.core.arrays import Floats


def garwood_interval(counts: ArrayLike, confidence: float = 0.95) -> tuple[Floats, Floats]:
    """Return the means between which counts, of any shape, lie with at least this confidence."""
    k = np.asarray(counts, np.float64)
    tail = (1 - confidence) / 2
    low = np.where(k > 0, chi2.ppf(tail, 2 * np.maximum(k, 1e-9)) / 2, 0.0)
    return low, np.asarray(chi2.isf(tail, 2 * (k + 1)) / 2)
