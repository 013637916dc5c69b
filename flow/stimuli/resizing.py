"""Resizing to fewer, larger pixels: spatial pooling as in the dissertation, and as in a sensor.

`nearest` takes, for each new pixel, the old pixel at its center, index ⌊(i + 0.5)·old/new⌋
(MATLAB's imresize, dissertation §4.2). It subsamples: values stay, light is lost. `area`
distributes the light of every old pixel over the new pixels that it overlaps: the total stays.
Pooling along x with a triangular kernel keeps the width except at the ends.
"""

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats

ResizeKind = Literal["nearest", "area"]


def resized_shape(shape: tuple[int, int], size: int | tuple[int, int]) -> tuple[int, int]:
    """Return the shape (H, W) that frames of another shape are resized to.

    `shape` (rows, columns) before; `size` int or (rows, columns): a single number is the rows, with
    columns in proportion.

    Raises ValueError if it has no pixels or more pixels along a side than before.
    """
    rows, columns = size if isinstance(size, tuple) else (size, round(shape[1] * size / shape[0]))
    if not (1 <= rows <= shape[0] and 1 <= columns <= shape[1]):
        raise ValueError(
            f"size {rows} × {columns} px of frames of {shape[0]} × {shape[1]} px:"
            " choose sizes from 1 px to that of the frames"
        )
    return rows, columns


def resize(
    frames: NDArray[Any], size: int | tuple[int, int], kind: ResizeKind = "nearest"
) -> NDArray[Any]:
    """Return frames (..., H, W) with fewer pixels, of a size as in `resized_shape`.

    "nearest" keeps values and type; "area" keeps the sum over each frame, as float64. Raises
    ValueError if the new size is not between 1 px and the old one.
    """
    rows, columns = resized_shape((frames.shape[-2], frames.shape[-1]), size)
    if kind == "area":
        y, x = _shares(frames.shape[-2], rows), _shares(frames.shape[-1], columns)
        return np.asarray(y @ frames.astype(np.float64) @ x.T)
    for axis, new in ((-2, rows), (-1, columns)):
        if frames.shape[axis] != new:
            centers = (2 * np.arange(new) + 1) * frames.shape[axis] // (2 * new)
            frames = np.take(frames, centers, axis)
    return frames


def triangular_pool(frames: NDArray[Any], taps: int = 5) -> Floats:
    """Return frames (..., W − taps + 1), each pixel a weighted mean of `taps` pixels along x.

    As in the dissertation's bench (§2.4.8), where weights 1, 2, 3, 2, 1 pool rows of 16 pixels to
    12: less shot noise, and less contrast between neighboring pixels. Only pixels with all of their
    neighbors are kept.

    `frames` (..., W): counts or intensities. `taps`: length of the kernel, odd, so that pixels stay
    in place: the new column j is centered on the old column j + (taps − 1)/2. Raises ValueError
    when it is even or not positive, or exceeds the width.
    """
    width = frames.shape[-1]
    if taps < 1 or taps % 2 == 0 or taps > width:
        raise ValueError(
            f"taps {taps} for rows of {width} px: use an odd number from 1 to the width"
        )
    half = (taps + 1) // 2
    weights = half - np.abs(np.arange(taps) - half + 1.0)
    windows = np.lib.stride_tricks.sliding_window_view(frames, taps, axis=-1)
    return np.asarray(windows @ (weights / weights.sum()), np.float64)


def _shares(old: int, new: int) -> Floats:
    """Return the share of each old pixel in each new one, (new, old)."""
    edges = np.arange(new + 1) * (old / new)
    edges[-1] = old
    pixels = np.arange(old)
    starts, ends = edges[:-1, np.newaxis], edges[1:, np.newaxis]
    return np.asarray((np.minimum(ends, pixels + 1) - np.maximum(starts, pixels)).clip(min=0))
