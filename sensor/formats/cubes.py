"""Products of the binary frames of a burst, as users of single-photon cameras compute them.

**Changes** are the events of a generalized event camera: a pixel sends its estimate m of the chance
of a detection in a binary frame, m ← m + (bit − m)/min(k, N) in the k-th frame since its last event
with the estimate s, as soon as k ≥ N and |m − s| > θ·√(p·(1 − p)/N), where p = (m + s)/2.

Source: Sundar et al., Generalized Event Cameras, CVPR 2024, arXiv 2407.02683, for events with
intensities and adaptive exponential means. The test in standard deviations is this program's.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from megalopta.sensor.formats.events import EventOrigin, events_hdf5_writer
from megalopta.sensor.formats.packed import npy_writer
from megalopta.sensor.formats.products import CubeSettings, Write
from megalopta.sensor.quantities import joined


@contextmanager
def sums_writer(
    path: Path, shape: tuple[int, ...], lengths: tuple[int, ...], every: int
) -> Iterator[Write]:
    """Yield a function that adds packed binary frames to a file of sums, (T, H, W[, lengths]).

    Of every so many frames, the first ones are summed: one or several lengths.
    """
    dtype = "|u1" if max(lengths) < 256 else "<u2"
    total, summed = np.zeros((1, *shape[1:3], len(lengths)), dtype), 0
    with npy_writer(path, shape, dtype) as write_sums:

        def write(packed: NDArray[np.uint8]) -> None:
            nonlocal summed
            for bits in np.unpackbits(packed, axis=2, count=shape[2]):
                for index in np.flatnonzero(np.array(lengths) > summed):
                    total[0, ..., index] += bits
                summed += 1
                if summed == every:
                    write_sums(total.reshape(1, *shape[1:]))
                    total[:], summed = 0, 0

        yield write


@contextmanager
def changes_writer(path: Path, origin: EventOrigin, cubes: CubeSettings) -> Iterator[Write]:
    """Yield a function that adds packed binary frames to a file of changes.

    `origin`: of binary frames. The time of an event is the end of its frame; its value is m.
    """
    shape, most, numbers = origin.shape[1:], cubes.change_frames, count(origin.first_frame)
    mean, sent, since = np.zeros(shape), np.full(shape, np.nan), np.zeros(shape)
    with events_hdf5_writer(path, origin, has_values=True) as write_events:

        def write(packed: NDArray[np.uint8]) -> None:
            for bits in np.unpackbits(packed, axis=2, count=shape[1]):
                since[:] += 1
                mean[:] += (bits - mean) / np.minimum(since, most)
                chance = (mean + sent) / 2
                limit = cubes.change_sigmas * np.sqrt(chance * (1 - chance) / most)
                sends = (since >= most) & ~(np.abs(mean - sent) <= limit)  # of NaN at first
                sent[sends], since[sends] = mean[sends], 0
                pixels = np.flatnonzero(sends).astype(np.uint32)
                ends_s = np.full(pixels.size, origin.frame_period_s)
                write_events(joined([(ends_s, pixels)], (1, *shape), next(numbers), mean[sends]))

        yield write
