"""Errors against the truth, split by speed and by occlusion.

A method may be right on average and wrong where it matters: on what hardly moves, on what moves
beyond its reach, beside things that hide each other. The speeds are those of the resized image, in
px per frame: whole-pixel methods read 0 below half a pixel, and beyond two the pyramids and search
radii begin to count. A block is at an occlusion when a tenth or more of its pixels are hidden in
the next frame; its true velocity is that of its other pixels.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from megalopta.flow.detectors import FloatArray
from megalopta.flow.metrics.endpoint_error import TruthError, truth_error

SLOW_PX = 0.5
FAST_PX = 2.0
OCCLUDED_SHARE = 0.1


def truth_splits(
    velocities: FloatArray, true_velocities: FloatArray, hidden: FloatArray
) -> Mapping[str, TruthError]:
    """Return the errors of each group of blocks under its name.

    Parameters
    ----------
    velocities : (T − 1, rows, columns, 2)
        As a detector gives them, px per frame.
    true_velocities : (T − 1, rows, columns, 2)
        From `block_flow` on the detector's blocks.
    hidden : (T − 1, rows, columns)
        Share of each block that is hidden in the next frame, from `block_share`.

    Returns
    -------
    mapping
        "slow", "medium" and "fast" share the blocks among them, and so do "clear" and "occlusion".

    Raises
    ------
    ValueError
        When the shapes differ.
    """
    return {
        name: truth_error(velocities, true_velocities, among)
        for name, among in _groups(true_velocities, hidden).items()
    }


def _groups(true_velocities: FloatArray, hidden: FloatArray) -> dict[str, NDArray[np.bool_]]:
    speed = np.hypot(true_velocities[..., 0], true_velocities[..., 1])
    return {
        "slow": speed < SLOW_PX,
        "medium": (speed >= SLOW_PX) & (speed < FAST_PX),
        "fast": speed >= FAST_PX,
        "clear": hidden < OCCLUDED_SHARE,
        "occlusion": hidden >= OCCLUDED_SHARE,
    }
