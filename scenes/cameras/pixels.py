"""What all cameras mean by a pixel and by a point that they cannot see."""

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]

# Points this near (rad) to where a projection is singular have no image.
SINGULAR_RAD = 1e-5

MOST_PX = 2**15
"""Rows or columns of an image, at most."""


def pixel_centers(width: int, height: int) -> Float64:
    """Image coordinates (H, W, 2) of all pixel centers, (x, y) in px."""
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    return np.stack([x, y], axis=-1)
