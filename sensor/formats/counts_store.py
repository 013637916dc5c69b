"""Counts on disk: one Zarr v3 group per sequence and sensor.

Arrays `counts`, `saturated` and, where the expectation was asked for, `photons`, `mean_events`,
`events_variance`, `mean_reading`, `reading_variance` (float32), each (frame, row, column) in chunks
of whole frames, with its unit as an attribute: counts, or electrons of a sensor that integrates.
The attributes of the group hold what made them: sensor, exposure, seed, sequence, illuminance. A
store is written under a temporary name and renamed, so it is there whole or not at all.
"""

import operator
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from megalopta.core.files import atomic_write
from megalopta.core.format_numbers import written
from megalopta.sensor.image_sensors import ImageSensor
from megalopta.sensor.quantities import Exposure

FORMAT = "megalopta counts"
FORMAT_KEY = "format_number"
"""Attribute of every Zarr group that the program writes."""
READINGS = ("counts", "saturated")
"""Arrays of every store."""
MOMENTS = ("photons", "mean_events", "events_variance", "mean_reading", "reading_variance")
"""Arrays of a store with its expectation."""

_MEANINGS = {
    "counts": "{unit} per exposure",
    "saturated": "true where the pixel was full",
    "photons": "mean photons on the pixel per exposure",
    "mean_events": "mean {event} per exposure",
    "events_variance": "{event}² per exposure",
    "mean_reading": "mean {unit} per exposure",
    "reading_variance": "{unit}² per exposure",
}
CHUNK_BYTES = 4 * 2**20
# As many as the stages write at once: of a larger chunk the rest would be read and written again.
_CHUNK_FRAMES = 16


@dataclass(frozen=True, eq=False, kw_only=True)
class Origin:
    """What made an exposure.

    Attributes
    ----------
    sensor : Sensor or CtiaSensor
    seed : int
    sequence : str or int
    illuminance_lux : float or None
        Light level of the scene, lux, where it is known.
    extra : dict
        Whatever else the writer noted; JSON values.
    """

    sensor: ImageSensor
    seed: int
    sequence: str | int
    illuminance_lux: float | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False, kw_only=True)
class StoredCounts(Origin):
    """An exposure and what made it."""

    exposure: Exposure


def write_counts(path: str | Path, stored: StoredCounts) -> None:
    """Write counts as a new store.

    Raises
    ------
    FileExistsError
        When something of this name exists.
    """
    with counts_writer(path, stored, len(stored.exposure.counts)) as write:
        write(stored.exposure)


@contextmanager
def counts_writer(
    path: str | Path, origin: Origin, frames: int
) -> Iterator[Callable[[Exposure], None]]:
    """Yield what appends frames to a new store; it appears when all are there.

    Parameters
    ----------
    path
    origin : Origin
    frames : int
        How many there will be.

    Raises
    ------
    FileExistsError
        When something of this name exists.
    """
    path = Path(path)
    if path.exists():
        raise FileExistsError(f"{path}: exists already; remove it or choose another name")
    with atomic_write(path) as temporary:
        group = zarr.open_group(
            temporary, mode="w", zarr_format=3, attributes=store_attributes(origin)
        )

        arrays: dict[str, zarr.Array[Any]] = {}
        written = 0

        def write(exposure: Exposure) -> None:
            nonlocal written
            first, written = written, written + len(exposure.counts)
            for name, values in _arrays(exposure):
                if name not in arrays:
                    unit = unit_of(name, origin.sensor)
                    arrays[name] = _created(group, name, frames, values, unit)
                arrays[name][first : first + len(values)] = values

        yield write


def _arrays(exposure: Exposure) -> Iterator[tuple[str, NDArray[Any]]]:
    for name in READINGS:
        yield name, getattr(exposure, name)
    for name in MOMENTS if exposure.expectation else ():
        yield name, getattr(exposure.expectation, name).astype(np.float32)


def unit_of(name: str, sensor: ImageSensor) -> str:
    """What the numbers of an array are."""
    event = "electrons" if sensor.unit == "electrons" else "events"
    return _MEANINGS[name].format(unit=sensor.unit, event=event)


def store_attributes(origin: Origin) -> dict[str, Any]:
    """What a store of counts says of itself."""
    sequence = origin.sequence
    return {
        "format": FORMAT,
        **format_attribute(),
        "sensor": origin.sensor.model_dump(mode="json"),
        "exposure_s": origin.sensor.exposure_s,
        "seed": operator.index(origin.seed),
        "sequence": sequence if isinstance(sequence, str) else operator.index(sequence),
        "illuminance_lux": origin.illuminance_lux,
        "extra": dict(origin.extra),
    }


def format_attribute() -> dict[str, Any]:
    """Return the attribute that tells the format of a Zarr group."""
    return {FORMAT_KEY: written("counts")}


def _created(
    group: zarr.Group, name: str, frames: int, like: NDArray[Any], unit: str
) -> "zarr.Array[Any]":
    per_chunk = max(1, min(frames, _CHUNK_FRAMES, CHUNK_BYTES // max(1, like[:1].nbytes)))
    return group.create_array(
        name,
        shape=(frames, *like.shape[1:]),
        dtype=like.dtype,
        chunks=(per_chunk, *like.shape[1:]),
        dimension_names=("frame", "row", "column"),
        attributes={"unit": unit},
        config={"write_empty_chunks": True},  # so that a lost one is not read as darkness
    )
