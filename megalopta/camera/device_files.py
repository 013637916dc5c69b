"""Device files: YAML, with maps as .npy files in a folder next to it.

`write_array_device` writes that of an array whose rates, crosstalk and afterpulses were measured as
tables. Tables of dark counts hold all events; the map is without what crosstalk and afterpulses
add, which the simulation adds again.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core import strict_yaml
from megalopta.core.arrays import Floats
from megalopta.core.files import atomic_write, write_text
from megalopta.report.text import number
from megalopta.sensor.calibrate.autocorrelation import Autocorrelation, fit_table
from megalopta.sensor.calibrate.device import Estimate
from megalopta.sensor.calibrate.pair_crosstalk import PairCrosstalk, fit_crosstalk
from megalopta.sensor.effects.afterpulsing import Afterpulsing
from megalopta.sensor.effects.crosstalk import Crosstalk, fired_mean

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


def write_device_file(path: Path, fields: Mapping[str, Any]) -> None:
    """Write the YAML of a device file."""
    write_text(path, f"# Written by megalopta spadcam calibrate.\n{strict_yaml.dump(fields)}")


_UP_TO_S = 8e-6
"""Longest delay of an afterpulse; later ones count as dark counts."""


def write_array_device(
    path: Path, tables: Sequence[PairCrosstalk | Autocorrelation | Floats], preset: str, source: str
) -> str:
    """Write a device file and its map of dark counts; return a summary in a sentence.

    Raises ValueError if a table does not suffice, or two are of one kind.
    """
    pairs, lags, rates = (_only(tables, kind) for kind in (PairCrosstalk, Autocorrelation, None))
    if rates is None:
        raise ValueError("no map of dark counts; give a table of them")
    talk = Crosstalk() if pairs is None else fit_crosstalk(pairs)
    pulses = Afterpulsing() if lags is None else fit_table(lags.of(slice(None), _UP_TO_S))
    counted = filled(rates)
    own = np.maximum(counted - fired_mean(counted, talk), 0) * (1 - pulses.mean_carriers)
    folder = path.with_suffix("")
    save_map(folder / "dark_counts.npy", own)
    fields: dict[str, Any] = {
        "preset": preset,
        "name": path.stem,
        "source": source,
        "measured": {"dark_counts": f"{folder.name}/dark_counts.npy", "fit": "exact"},
    }
    for name, effect in (("crosstalk", talk), ("afterpulsing", pulses)):
        if effect.is_on:
            fields[name] = effect.model_dump(mode="json", exclude_defaults=True)
    write_device_file(path, fields)
    return (
        f"{rates.size} pixels, {int(np.isnan(rates).sum())} unknown; dark counts "
        f"{number(float(np.nanmedian(rates)))} Hz (median), crosstalk "
        f"{number(100 * talk.mean_fired_neighbors)} %, afterpulses "
        f"{number(100 * pulses.mean_carriers)} %"
    )


def _only(tables: Sequence[Any], kind: type | None) -> Any:
    """Return the table of a kind (None: a map), or None."""
    known = (PairCrosstalk, Autocorrelation)
    found = [
        each
        for each in tables
        if (not isinstance(each, known) if kind is None else isinstance(each, kind))
    ]
    if len(found) > 1:
        raise ValueError(f"{len(found)} tables of one kind; give those of one array")
    return found[0] if found else None
