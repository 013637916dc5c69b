"""The velocity that all pairs of several frames agree on, from their correlations.

If the texture of a patch is a draw of a Gaussian process of power spectrum S(ω), moves by v per
frame, and is seen n times with white noise of variance N, the log-likelihood of v is, up to a
constant (the texture integrated out; `flow.metrics.unknown_texture`),

    ½·Σ_ω S/(N·(N + n·S))·|Σ_t y_t(ω)·exp(iω·v·t)|²

whose part that depends on v is a sum over pairs of frames: their correlation, filtered, at the
displacement v·k of frames k apart. So frames count together of which no two alone show more than
noise. N is the mean count, S falls with the frequency from the counts' excess variance.

Pairs overlap less the farther they are displaced, and tell as much less. Neither the edge of a
patch nor texture that is no Gaussian process enters, which costs precision where photons abound.
"""

import math
from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.fft import irfft2, next_fast_len, rfft2

from megalopta.flow.detectors.base import FloatArray, Frames
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.shift_cost import parabola_minimum

_STEPS_PER_PX = 2
"""Velocities tried, before interpolation"""

_SLOPE, _LARGEST_PATTERN = 2.6, 0.02
"""S goes as (ω² + 0.02)^−1.3, ω in rad/px: between dead leaves and photographs"""

_LEAST_CONTRAST = 0.1


class Patches:
    """Spectra of the counts of one frame around each block.

    Parameters
    ----------
    counts : (H, W)
    grid
        Blocks.
    margin_px : int
        How far around a block a patch reaches, as far as the frame goes.
    """

    def __init__(self, counts: Frames, grid: BlockGrid, margin_px: int) -> None:
        self.side = grid.block_px + 2 * margin_px
        size = next_fast_len(2 * self.side, real=True)
        cut = np.zeros((grid.rows * grid.columns, size, size), np.float32)
        self.moments = np.empty((3, len(cut)))
        """Sums of 1, counts and squared counts"""
        for index, (top, left) in enumerate(grid.corners):
            rows, columns = (
                slice(max(first - margin_px, 0), first + grid.block_px + margin_px)
                for first in (top, left)
            )
            seen = counts[rows, columns].astype(np.float64)
            self.moments[:, index] = seen.size, seen.sum(), np.sum(seen**2)
            cut[index, : seen.shape[0], : seen.shape[1]] = seen - seen.mean()
        self.spectra: NDArray[np.complex64] = rfft2(cut)


def agreed_velocities(frames: Sequence[Patches], radius_px: int) -> FloatArray:
    """Return the most likely velocity (x, y) of each patch, (patches, 2), px per frame.

    NaN where all are as likely: fewer than two of its frames show any pattern.

    Parameters
    ----------
    frames
        Oldest first, two or more.
    radius_px : int
        Largest velocity tried in x and in y.
    """
    pixels, total, squares = np.sum([each.moments for each in frames], axis=0)
    size = frames[0].spectra.shape[1]
    steps = radius_px * _STEPS_PER_PX
    scores = np.zeros((2 * steps + 1, 2 * steps + 1))
    velocities = np.full((len(pixels), 2), np.nan)
    for patch in np.flatnonzero(total):
        mean = total[patch] / pixels[patch]
        excess = squares[patch] / pixels[patch] - mean**2 - mean
        weight = pair_weight(size, max(excess, (_LEAST_CONTRAST * mean) ** 2), mean, len(frames))
        seen = np.stack([each.spectra[patch] for each in frames])
        crosses = [
            np.sum(seen[:-apart].conj() * seen[apart:], axis=0) for apart in range(1, len(frames))
        ]
        correlations = irfft2(np.stack(crosses) * weight, (size, size))
        add_up_pairs(correlations, frames[0].side, scores)
        if np.ptp(scores) > 0:
            velocities[patch] = _peak(scores)
    return velocities


def pair_weight(size: int, excess: float, noise: float, frames: int) -> NDArray[np.float32]:
    """Return S/(N·(N + n·S)) at the frequencies of `rfft2`."""
    omega = 2 * math.pi * np.hypot(np.fft.fftfreq(size)[:, np.newaxis], np.fft.rfftfreq(size))
    shape = (omega**2 + _LARGEST_PATTERN) ** (-_SLOPE / 2)
    spectrum = excess * shape * size**2 / (2 * shape.sum())  # the variance is the mean power
    return np.asarray(spectrum / (noise * (noise + frames * spectrum)), np.float32)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def add_up_pairs(correlations: NDArray[np.float32], side: int, scores: FloatArray) -> None:
    """Add up, for each velocity, the correlations of frames k apart at k times it."""
    size, middle = correlations.shape[1], len(scores) // 2
    for i in range(len(scores)):
        for j in range(len(scores)):
            total = 0.0
            for before in range(len(correlations)):
                x = (j - middle) * (before + 1) / _STEPS_PER_PX
                y = (i - middle) * (before + 1) / _STEPS_PER_PX
                if abs(x) >= side or abs(y) >= side:  # nothing overlaps
                    break
                left, above = math.floor(x), math.floor(y)
                a, b = x - left, y - above
                image = correlations[before]
                total += (1 - b) * (
                    (1 - a) * image[above % size, left % size]
                    + a * image[above % size, (left + 1) % size]
                ) + b * (
                    (1 - a) * image[(above + 1) % size, left % size]
                    + a * image[(above + 1) % size, (left + 1) % size]
                )
            scores[i, j] = total


def _peak(scores: FloatArray) -> FloatArray:
    """Return the velocity (x, y) of the highest score, between those tried by a parabola."""
    steps = len(scores) // 2
    best = np.array(np.unravel_index(scores.argmax(), scores.shape))
    around = np.full((1, 3, 3), np.inf)
    if (best > 0).all() and (best < 2 * steps).all():
        around[0] = -scores[best[0] - 1 : best[0] + 2, best[1] - 1 : best[1] + 2]
    return np.asarray((best[::-1] - steps + parabola_minimum(around)[0]) / _STEPS_PER_PX)
