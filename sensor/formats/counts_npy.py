"""Counts as one plain .npy file, (frames, rows, columns)."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from megalopta.core.files import atomic_write
from megalopta.sensor.formats.products import Write
from megalopta.sensor.quantities import Exposure


@contextmanager
def counts_npy_writer(path: Path, shape: tuple[int, int, int]) -> Iterator[Write]:
    """Yield what appends the counts of exposures."""
    with atomic_write(path) as temporary:
        counts = np.lib.format.open_memmap(temporary, "w+", np.uint32, shape)
        frame = 0

        def write(exposure: Exposure) -> None:
            nonlocal frame
            counts[frame : frame + len(exposure.counts)] = exposure.counts
            frame += len(exposure.counts)

        yield write
        counts.flush()
