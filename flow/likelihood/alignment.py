"""Frames aligned by a motion, and values at pixels and at the nodes of a motion."""

import math
from collections.abc import Iterable, Iterator

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

from megalopta.core.arrays import Floats, Mask
from megalopta.flow.likelihood import roots


def aligned_frames(level: roots.Level, places: Iterable[Floats]) -> tuple[Floats, Mask, Floats]:
    """Return the roots of frames (n, H, W) at places, which places are in all frames, and gains.

    Brightness that differs from frame to frame by a factor is equalized, by these gains: (n, 1, 1),
    or (n, H, W) if the factor varies over the frame.
    """
    shape = level.roots.shape[1:]
    inside = np.ones(shape, np.bool_)
    aligned = np.empty_like(level.roots)
    for frame, splines, moved in zip(aligned, level.splines, places, strict=True):
        roots.interpolate(splines, moved, frame, inside)
    mean = aligned.mean(axis=0) * inside
    sums = to_nodes(np.concatenate((mean[np.newaxis], aligned)) * mean)
    if math.isinf(level.gain_px):
        power, *shared = sums.sum(axis=(1, 2), keepdims=True)
    else:
        near = 0, *(level.gain_px / roots.NODE_PX,) * 2
        around = gaussian_filter(sums, near, mode="nearest", truncate=3.0)
        power, *shared = finer(around, shape, roots.NODE_PX)
    # roots of less power than 1e-9 tell no gain
    gains = np.divide(power, shared, out=np.ones_like(shared), where=np.array(shared) > 1e-9)
    aligned *= gains
    return aligned, inside, gains


def times_from_reference(frames: int) -> Floats:
    """Return the times of frames relative to the one before the middle, (frames,)."""
    return np.arange(frames, dtype=np.float64) - (frames // 2 - 1)


def place_of_pixels(level: roots.Level, flow: Floats) -> Iterator[Floats]:
    """Yield the places (2, H, W) in each frame of the content of pixels, given a flow at nodes."""
    shape = level.roots.shape[1:]
    pixels = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    motion = finer(flow, shape, roots.NODE_PX)[::-1]
    return (pixels + time * motion for time in times_from_reference(len(level.roots)))


def finer(coarse: Floats, shape: tuple[int, ...], factor: int) -> Floats:
    """Return values (k, n, m) on a finer grid of this shape, by linear interpolation."""
    for axis, side in enumerate(shape, start=1):
        last = coarse.shape[axis] - 1
        place = ((np.arange(side) + 0.5) / factor - 0.5).clip(0, last)
        before = place.astype(np.intp)
        share = np.expand_dims(place - before, tuple(range(axis, 2)))
        start = coarse.take(before, axis)
        coarse = start + share * (coarse.take(np.minimum(before + 1, last), axis) - start)
    return coarse


def to_nodes(pixels: Floats) -> Floats:
    """Return sums of (c, H, W) over the squares around nodes."""
    rows, columns = (np.arange(0, side, roots.NODE_PX) for side in pixels.shape[1:])
    return np.asarray(np.add.reduceat(np.add.reduceat(pixels, rows, 1), columns, 2))


def round_trip(there: Floats, back: Floats) -> Floats:
    """Return how far from its start (H, W) a flow leads, and the flow back from where it ends.

    `there`, `back` (2, H, W), in the unit of the grid: of the first frame, and of the second back.
    Infinite where the flow is undefined or leaves the frame.
    """
    ends = np.mgrid[: there.shape[1], : there.shape[2]] + there[::-1]
    places = np.nan_to_num(ends, nan=-1)
    returned = [map_coordinates(part, places, order=1, cval=math.inf) for part in back]
    distance = np.hypot(*(there + returned))
    return np.where(np.isfinite(distance), distance, math.inf)
