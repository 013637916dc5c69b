"""What scales a clean sequence to a photon flux, and photon counts drawn from mean counts.

Thesis §4.2: mean counts λ = F·I/ΣI + dark counts, counts ~ Poisson(λ), with the flux F in photons
per frame. ΣI is here `brightness`, the mean over the sequence, so that a scene that grows darker
does; for one image, or a scene of constant brightness, there is no difference.

Every frame is drawn from a stream of its own, named by the seed, the caller's key and the number
of the frame, so the counts of a frame do not depend on how the sequence is cut. Different fluxes
are drawn independently of each other.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.sensor.sampling import draw_poisson, generator

_LARGEST_MEAN = 9e18
Counts = NDArray[np.unsignedinteger[Any]]


def brightness(frames: NDArray[Any]) -> float:
    """Return the mean over a sequence (T, H, W) of the sum over a frame.

    Raises
    ------
    ValueError
        When the frames are not a sequence of finite, non-negative light with some light in it.
    """
    if frames.ndim != 3 or frames.size == 0:
        raise ValueError(f"frames of shape {frames.shape}: give a sequence (T, H, W)")
    mean = float(frames.sum(axis=(1, 2), dtype=np.float64).mean())
    if not (frames.min() >= 0 and np.isfinite(mean)):
        raise ValueError("frames hold negative or non-finite values: give light, 0 or more")
    if mean == 0:
        raise ValueError("frames are black: there is nothing to scale to a photon flux")
    return mean


def draw_counts(
    means: NDArray[np.float64], seed: int, *key: str | int, first_frame: int = 0
) -> Counts:
    """Return Poisson counts of the given means, as uint16, uint32 or uint64, whichever suffices.

    Parameters
    ----------
    means : (n, H, W)
        Mean counts of consecutive frames.
    seed : int
        Any integer.
    *key : str or int
        What else tells this draw from others, such as the name of the sequence.
    first_frame : int
        Number of the first of these frames in its sequence.

    Raises
    ------
    ValueError
        When a mean is negative, not a number or above 9e18.
    """
    if not (means.min(initial=0) >= 0 and means.max(initial=0) <= _LARGEST_MEAN):
        raise ValueError(
            f"means from {means.min():g} to {means.max():g}: give mean counts from 0 to"
            f" {_LARGEST_MEAN:g}"
        )
    counts = np.empty(means.shape, np.int64)
    for index, mean in enumerate(means):
        rng = generator(seed, "photons", *key, first_frame + index)
        counts[index] = draw_poisson(rng, mean.ravel()).reshape(mean.shape)
    return narrowest(counts)


def narrowest(counts: NDArray[np.integer[Any]]) -> Counts:
    """Return counts as uint16, uint32 or uint64, whichever suffices."""
    largest = int(counts.max(initial=0))
    if largest < 2**16:
        return counts.astype(np.uint16, copy=False)
    return counts.astype(np.uint32 if largest < 2**32 else np.uint64, copy=False)
