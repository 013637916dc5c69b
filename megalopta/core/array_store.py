"""Arrays cached on disk under a hash of what they depend on, by any number of processes."""

import contextlib
import math
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core import files
from megalopta.core.bounded import zipped_arrays

Arrays = Mapping[str, NDArray[Any]]


class ArrayStore:
    """One set of named arrays in a folder; without a folder nothing is kept.

    The key is a hash of everything that the arrays depend on. Above the size limit of the folder,
    the least recently used arrays are removed.
    """

    def __init__(self, folder: Path | None, key: str, most_bytes: float = math.inf) -> None:
        self._path = folder / f"{key}.npz" if folder else None
        self._most_bytes = most_bytes

    def read(self, names: Iterable[str] | None = None) -> dict[str, NDArray[Any]] | None:
        """Return the kept arrays, all by default; None if none are kept or a file is damaged."""
        if self._path is None:
            return None
        try:
            arrays = zipped_arrays(self._path, names, "biufcU")
            self._path.touch()
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None
        return arrays

    def write(self, arrays: Arrays) -> None:
        """Keep arrays if there is space."""
        if self._path is None:
            return
        with contextlib.suppress(OSError):
            with files.atomic_write(self._path, lasting=False) as temporary:
                np.savez(temporary, **dict[str, Any](arrays))
            kept = sorted(self._path.parent.glob("*.npz"), key=lambda path: -path.stat().st_mtime)
            sizes = np.cumsum([path.stat().st_size for path in kept])
            for path, size in zip(kept[1:], sizes[1:], strict=True):
                if size > self._most_bytes:
                    path.unlink(missing_ok=True)
