"""Arrays kept on disk under a hash of all that they depend on, for whoever needs them again.

A folder may have any number of readers and writers: files appear whole, and what is missing or
damaged is computed again. Every room may import this module.
"""

import contextlib
import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core import files

Arrays = Mapping[str, NDArray[Any]]


class ArrayStore:
    """One set of named arrays in a folder; without a folder nothing is kept.

    The key is a hash of all that the arrays depend on. Beyond the most bytes that may be kept in
    the folder goes what was used the longest ago.
    """

    def __init__(self, folder: Path | None, key: str, most_bytes: int) -> None:
        self._path = folder / f"{key}.npz" if folder else None
        self._most_bytes = most_bytes

    def read(self, names: Iterable[str] | None = None) -> dict[str, NDArray[Any]] | None:
        """What was kept, by default all; None where nothing was or what is there is damaged."""
        if self._path is None:
            return None
        try:
            with self._path.open("rb") as file, np.load(file) as found:
                arrays = {name: found[name] for name in (found if names is None else names)}
            self._path.touch()
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return None
        return arrays

    def write(self, arrays: Arrays) -> None:
        """Keep arrays if there is room."""
        if self._path is None:
            return
        with contextlib.suppress(OSError):
            with files.atomic_write(self._path) as temporary, temporary.open("wb") as file:
                np.savez(file, allow_pickle=False, **arrays)
            _prune(self._path.parent, self._most_bytes)


def _prune(folder: Path, most_bytes: int) -> None:
    """Remove what was used the longest ago, beyond what may stay."""
    kept = sorted(folder.glob("*.npz"), key=lambda path: -path.stat().st_mtime)
    sizes = np.cumsum([path.stat().st_size for path in kept])
    for path, size in zip(kept[1:], sizes[1:], strict=True):
        if size > most_bytes:
            path.unlink(missing_ok=True)
