"""Passages of the plate's edge in a recording, found by what the array counts; and their light.

A recording of the motion bench begins at any time, and the plate waits at its ends as long as it
likes. The mean count of the array falls while an edge hides it and rises while one leaves it free;
where it is halfway, the edge is in the middle. Each such passage is cut out like those that
`motion_bench` simulates: 32 frames around the edge that hides, then 32 around the next that frees.
"""

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from megalopta.camera.motion_bench import FRAMES, BenchLight
from megalopta.core.arrays import Floats
from megalopta.sensor import Sensor, reading_moments
from megalopta.sensor.spad.device import draw_fixed_pattern

LEAST = 2
"""Passages to and fro; one tells nothing of chance."""
_CLEAR = 6.0
"""Standard deviations of the array's mean count that an edge changes it by, at least."""
_SHARE_BEYOND = 0.25
"""An edge passes when the mean count goes from this close to one level to this close to the other,
as a share of what is between them."""
_CLOSEST = FRAMES - 2
"""Frames between edges: half a frame before its middle, and half after, may be lost to rounding."""

_BRIGHTEST = 1e6
"""Photons that a pixel of any light detects in a frame, at most"""


class _Edge(NamedTuple):
    middle: float
    """When half of the array is hidden, in frames from the opening of the first."""
    hides: bool


def cut_passages(counts: NDArray[Any], numbers: NDArray[Any] | None = None) -> NDArray[Any]:
    """Cut the passages of an edge out of frames (T, rows, columns), one after the other.

    Where frames have numbers, (T,), passages of which a frame is missing are left out.

    Returns
    -------
    (passages · 2 · FRAMES, rows, columns)

    Raises
    ------
    ValueError
        When no edge passes, too few do, or they follow each other too closely.
    """
    edges = list(_edges(np.asarray(counts.mean(axis=(1, 2)), np.float64)))
    apart = [after.middle - before.middle for before, after in pairwise(edges)]
    if apart and min(apart) < _CLOSEST:
        raise ValueError(
            f"an edge passes {min(apart):.0f} frames after another; let the plate rest at its ends "
            f"so that {FRAMES} frames lie between"
        )
    starts = [(round(each.middle) - FRAMES // 2, each.hides) for each in edges]
    number = np.arange(len(counts)) if numbers is None else numbers.astype(np.int64)
    whole = [
        each
        for each in starts
        if 0 <= each[0] <= len(counts) - FRAMES
        and number[each[0] + FRAMES - 1] - number[each[0]] == FRAMES - 1
    ]
    pairs = [(first, second) for (first, hides), (second, _) in pairwise(whole) if hides]
    if len(pairs) < LEAST:
        raise ValueError(
            f"{len(pairs)} passages of the plate to and fro in {len(counts)} frames; record "
            f"{LEAST} or more"
        )
    return np.concatenate([counts[at : at + FRAMES] for pair in pairs for at in pair])


def cut_rest(counts: NDArray[Any]) -> NDArray[Any]:
    """Cut frames (T, rows, columns) of a plate at rest into as many as a passage to and fro has.

    Raises
    ------
    ValueError
        When they are too few, or an edge passes.
    """
    whole = len(counts) // (2 * FRAMES)
    if whole < LEAST:
        raise ValueError(f"{len(counts)} frames; record {LEAST * 2 * FRAMES} or more")
    level = np.asarray(counts.mean(axis=(1, 2)), np.float64)
    if _is_clear(level):
        raise ValueError("an edge passes, though the plate is said to rest; give its speed")
    return counts[: whole * 2 * FRAMES]


def _is_clear(level: Floats) -> bool:
    low, high = np.percentile(level, (5, 95))
    # Of a normal distribution the median distance of neighbors is 0.954 σ.
    return bool(high - low > _CLEAR * np.median(np.abs(np.diff(level))) / 0.954)


def _edges(level: Floats) -> Iterator[_Edge]:
    """Find where the level goes down to the lower or up to the upper of its two ends."""
    if not _is_clear(level):
        raise ValueError(
            f"no edge passes, the array counts {level.mean():.1f} per pixel in every frame; let "
            "the plate pass, or give speed 0 for one at rest"
        )
    half = np.percentile(level, (5, 95)).mean()
    hidden, free = np.median(level[level < half]), np.median(level[level > half])
    share = (level - hidden) / (free - hidden)
    known = np.flatnonzero((share < _SHARE_BEYOND) | (share > 1 - _SHARE_BEYOND))
    for before, after in pairwise(known):
        hides = bool(share[before] > 0.5)
        if hides == bool(share[after] > 0.5):
            continue
        falling = (share[before : after + 1] - 0.5) * (1 if hides else -1)
        last = np.flatnonzero((falling[:-1] > 0) & (falling[1:] <= 0))[-1]
        # The level of a frame is that of its middle.
        part = falling[last] / (falling[last] - falling[last + 1])
        yield _Edge(float(before + last + part + 0.5), hides)


def fitted_light(counts: NDArray[Any], sensor: Sensor) -> BenchLight:
    """Return the light under which the model of a sensor reads, on average, what a recording has.

    Parameters
    ----------
    counts : (passages · 2 · FRAMES, rows, columns)
        As `cut_passages` cuts them: in the first quarter of a passage all pixels are open, in the
        last quarter of its first half all are hidden.
    sensor : Sensor
        Of the same exposure. Its dark counts are taken as they are.

    Raises
    ------
    ValueError
        When counters are so full that they do not tell the light.
    """
    hiding = counts.reshape(-1, 2, FRAMES, *counts.shape[1:])[:, 0]
    quarter = FRAMES // 4
    factor = draw_fixed_pattern(sensor, (counts.shape[1], counts.shape[2])).efficiency_factor
    one_hz = factor[None] / (factor.mean() * sensor.exposure_s)

    def read(photons: float) -> float:
        return float(reading_moments(photons * one_hz, sensor)[0].mean())

    levels = hiding[:, :quarter].mean(), hiding[:, -quarter:].mean()
    return BenchLight(*(_photons(read, float(level)) for level in levels))


def _photons(read: Callable[[float], float], level: float) -> float:
    """Return the photons at which a pixel reads a level on average."""
    if level <= read(0.0):
        return 0.0
    most = 2 * level + 1
    while read(most) < level:
        most *= 2
        if most > _BRIGHTEST:
            raise ValueError(
                f"an open pixel counts {level:.4g} on average, more than the model does in any "
                "light; record it with less light"
            )
    return float(brentq(lambda each: read(each) - level, 0.0, most, xtol=1e-3))
