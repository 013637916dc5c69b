"""Array types by content, arrays from files, and spread. Every folder may import this module."""

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]


def plain_array(content: bytes) -> NDArray[Any] | None:
    """Return the numbers in the content of a .npy file; None if it is damaged or not numeric."""
    try:
        values = np.lib.format.read_array(io.BytesIO(content), allow_pickle=False)
    except Exception:  # a damaged header can raise any exception
        return None
    return values if values.dtype.kind in "fiu" else None


def robust_sigma(apart: Floats) -> float:
    """Return the standard deviation of normal differences from their center, by the median."""
    return 1.4826 * float(np.median(np.abs(apart)))
