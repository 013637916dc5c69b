"""Photon counts: clean sequences resized and scaled to a flux, and counts drawn from mean counts.

Thesis §4.2: mean counts λ = F·I/ΣI + dark counts, counts ~ Poisson(λ), with the flux F in photons
per frame and ΣI the sum over the frame. Every frame is drawn from its own stream, keyed by the
seed, the caller's key and the number of the frame.

**Resizing** to fewer, larger pixels: `nearest` takes, for each new pixel, the old pixel at its
center, index ⌊(i + 0.5)·old/new⌋ (MATLAB's imresize, dissertation §4.2), and loses light. `area`
distributes the light of every old pixel over the new pixels that it overlaps.
"""

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.sensor.sampling.poisson import fill_poisson, poisson_streams
from megalopta.sensor.sampling.streams import generator

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


def triangular_pool(frames: NDArray[Any]) -> Floats:
    """Return frames (..., W − 4), each pixel a weighted mean of five pixels along x.

    As in the dissertation's bench (§2.4.8), where weights 1, 2, 3, 2, 1 pool rows of 16 pixels to
    12: less shot noise, and less contrast between neighboring pixels. Only pixels with all of their
    neighbors are kept.

    `frames` (..., W): counts or intensities, five columns or more.
    """
    weights = np.array([1.0, 2.0, 3.0, 2.0, 1.0])
    windows = np.lib.stride_tricks.sliding_window_view(frames, len(weights), axis=-1)
    return np.asarray(windows @ (weights / weights.sum()), np.float64)


def _shares(old: int, new: int) -> Floats:
    """Return the share of each old pixel in each new one, (new, old)."""
    edges = np.arange(new + 1) * (old / new)
    edges[-1] = old
    pixels = np.arange(old)
    starts, ends = edges[:-1, np.newaxis], edges[1:, np.newaxis]
    return np.asarray((np.minimum(ends, pixels + 1) - np.maximum(starts, pixels)).clip(min=0))


_LARGEST_MEAN = 9e18
Counts = NDArray[np.unsignedinteger[Any]]


class BlackFrameError(ValueError):
    """A frame without light cannot be scaled to a flux."""


def frame_light(frames: NDArray[Any]) -> Floats:
    """Return the sum over each frame of (T, H, W), (T,).

    Raises ValueError if the frames are not a sequence of finite light, 0 or more.
    """
    if frames.ndim != 3 or frames.size == 0:
        raise ValueError(f"frames of shape {frames.shape}: give a sequence (T, H, W)")
    # frame by frame, so that rounding does not depend on chunks
    sums = np.array([np.ascontiguousarray(frame).sum(dtype=np.float64) for frame in frames])
    if not (frames.min() >= 0 and np.isfinite(sums).all()):
        raise ValueError("frames hold negative or non-finite values: give light, 0 or more")
    return sums


def not_black(light: Floats) -> Floats:
    """Return the sums over frames, (T,). Raises BlackFrameError if one cannot be scaled."""
    if not light.min() > 0:
        raise BlackFrameError(
            f"frame {int(np.argmin(light))} is black and cannot be scaled to a photon flux; "
            "give light in every frame"
        )
    return light


def draw_counts(means: Floats, seed: int, *key: str | int, first_frame: int = 0) -> Counts:
    """Return Poisson counts of means (n, H, W), as uint16, uint32 or uint64, whichever suffices.

    Every frame has its own random stream, of seed, key (such as the name of the sequence) and its
    number, from `first_frame` on. Raises ValueError if a mean is negative, NaN or above 9e18.
    """
    largest = means.max(initial=0)
    if not (means.min(initial=0) >= 0 and largest <= _LARGEST_MEAN):
        raise ValueError(
            f"means from {means.min():g} to {largest:g}: give mean counts from 0 to"
            f" {_LARGEST_MEAN:g}"
        )
    frames = enumerate(means, first_frame)
    brightest = float(largest)
    return np.stack([draw_in_one(mean, 1.0, 0.0, brightest, seed, *key, at) for at, mean in frames])


def draw_in_one(
    light: Floats, flux: float, dark_counts: float, brightest: float, seed: int, *key: str | int
) -> Counts:
    """Return counts of means flux·light + dark_counts, from one random stream, as `draw_counts`.

    Fewer frames are the first of more. The light, of any shape, must be finite, 0 or more, and not
    above `brightest`: unchecked.
    """
    most = brightest * flux + dark_counts
    # beyond 40 deviations is less than 10⁻²⁰⁰
    counts = np.empty(light.shape, _type_of(most + 40 * math.sqrt(most) + 100))
    largest = min(int(np.iinfo(counts.dtype).max), int(np.iinfo(np.int64).max))
    streams = poisson_streams(generator(seed, "photons", *key))
    dark = np.array([dark_counts / flux])
    fill_poisson(streams, light.ravel(), dark, flux, counts.reshape(-1), largest)
    return counts


def narrowest(counts: NDArray[np.integer[Any]]) -> Counts:
    """Return counts of any shape as uint16, uint32 or uint64, whichever suffices."""
    return counts.astype(_type_of(int(counts.max(initial=0))), copy=False)


def _type_of(largest: float) -> type[np.unsignedinteger[Any]]:
    kinds = (np.uint16, np.uint32)
    return next((kind for kind in kinds if largest <= np.iinfo(kind).max), np.uint64)
