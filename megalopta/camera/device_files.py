"""Maps of a device file: .npy files in a folder next to it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.core.files import atomic_write
from megalopta.sensor.calibrate.device import Estimate

_INTERVALS = ("low", "high")


def write_maps(folder: Path, maps: Mapping[str, Estimate]) -> dict[str, str]:
    """Write the known maps and their intervals; return each path relative to the device file.

    Pixels without an estimate get the median; their intervals are NaN.
    """
    named = {}
    for name, estimate in maps.items():
        if not np.isfinite(estimate.value).any():
            continue
        lowest = 0.0 if name in ("dark_counts", "efficiency") else -np.inf
        save_map(folder / f"{name}.npy", np.maximum(filled(estimate.value), lowest))
        for end in _INTERVALS:
            save_map(folder / f"{name}_{end}.npy", getattr(estimate, end))
        named[name] = f"{folder.name}/{name}.npy"
    return named


def filled(values: Floats) -> Floats:
    """Return maps with missing values replaced by the median."""
    return np.where(np.isfinite(values), values, np.nanmedian(values))


def save_map(path: Path, values: NDArray[Any]) -> None:
    """Write a map once it is complete."""
    with atomic_write(path) as temporary:
        np.save(temporary, values)
