"""Whether readings change in time alike: spectra of pixels, averaged over the array."""

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats

SEGMENT = 32
BANDS = 4


def band_powers(counts: NDArray[np.floating]) -> Floats:
    """Share of each band in the power of segments of frames, (segments, BANDS).

    White noise has the same power in each of the `SEGMENT`/2 frequencies.
    """
    segments = len(counts) // SEGMENT
    if segments < 2:
        return np.empty((0, BANDS))
    pieces = np.asarray(counts[: segments * SEGMENT], np.float64)
    pieces = pieces.reshape(segments, SEGMENT, -1)
    power = mean_spectrum(pieces)[:, 1:]
    bands = np.add.reduceat(power, np.linspace(0, SEGMENT // 2, BANDS + 1).astype(int)[:-1], axis=1)
    return np.asarray(bands / np.maximum(bands.sum(axis=1, keepdims=True), 1e-300))


def mean_spectrum(pieces: Floats) -> Floats:
    """Power over frequency (segments, SEGMENT/2 + 1), mean over the pixels of (…, SEGMENT, P)."""
    apart = pieces - pieces.mean(axis=-2, keepdims=True)
    transform = np.fft.rfft(apart, axis=-2)
    return np.asarray(np.square(np.abs(transform)).mean(axis=-1) / pieces.shape[-2])
