"""Counts on disk: one Zarr v3 group per sequence and sensor.

Arrays `counts`, `expected` and `saturated`, each (frame, row, column) in chunks of whole frames,
with its unit as an attribute: counts, or electrons of a sensor that integrates. The attributes of
the group hold what made them: sensor, exposure, seed, sequence, illuminance. A store is written
under a temporary name and renamed, so it is there whole or not at all.
"""

import operator
import textwrap
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
import zarr
from numpy.typing import NDArray
from pydantic import TypeAdapter

from megalopta.files import atomic_write
from megalopta.sensor.readout.images import ImageSensor
from megalopta.sensor.spad import Exposure

_IMAGE_SENSOR: TypeAdapter[ImageSensor] = TypeAdapter(ImageSensor)
_FORMAT = "megalopta counts"
_KINDS = {"counts": "uf", "expected": "f", "saturated": "b"}
_MEANINGS = {
    "counts": "{unit} per exposure",
    "expected": "mean {unit} per exposure",
    "saturated": "true where the pixel was full",
}
_CHUNK_BYTES = 4 * 2**20


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
        write(0, stored.exposure)


@contextmanager
def counts_writer(
    path: str | Path, origin: Origin, frames: int
) -> Iterator[Callable[[int, Exposure], None]]:
    """Yield what writes frames into a new store, from a number on; it appears when all are there.

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
        group = zarr.open_group(temporary, mode="w", zarr_format=3, attributes=_attributes(origin))

        def write(first: int, exposure: Exposure) -> None:
            for name, meaning in _MEANINGS.items():
                values = getattr(exposure, name)
                if name not in group:
                    unit = meaning.format(unit=origin.sensor.unit)
                    _create_array(group, name, frames, values, unit)
                array = cast("zarr.Array[Any]", group[name])
                array[first : first + len(values)] = values

        yield write


def read_counts(path: str | Path) -> StoredCounts:
    """Read a store that `write_counts` wrote.

    Raises
    ------
    FileNotFoundError
        When there is nothing of this name.
    ValueError
        When it is something else, lacks a part or is damaged.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such counts store")
    try:
        group = zarr.open_group(path, mode="r")
        attributes: dict[str, Any] = dict(group.attrs)
    except Exception as problem:  # of a damaged file, anything
        raise ValueError(f"{path}: not a Zarr group; give a folder of counts") from problem
    if attributes.get("format") != _FORMAT:
        raise ValueError(f"{path}: a Zarr group, but not one of counts; give a folder of counts")
    try:
        return StoredCounts(
            exposure=_read_exposure(group),
            sensor=_IMAGE_SENSOR.validate_python(attributes["sensor"]),
            **{name: attributes[name] for name in ("seed", "sequence", "illuminance_lux", "extra")},
        )
    except KeyError as missing:
        raise ValueError(f"{path}: lacks {missing}; write the counts again") from missing
    except Exception as problem:
        reason = textwrap.shorten(str(problem), 200)
        raise ValueError(f"{path}: damaged ({reason}); write the counts again") from problem


def _read_exposure(group: zarr.Group) -> Exposure:
    """Frames of a store, if its arrays fit together."""
    shapes, arrays = [], []
    for name, kinds in _KINDS.items():
        array = group[name]
        if not isinstance(array, zarr.Array) or array.dtype.kind not in kinds:
            raise ValueError(f"{name} is no array of its kind of numbers")
        arrays.append(array)
        shapes.append(array.shape)
    if len(shapes[0]) != 3 or len(set(shapes)) > 1:
        raise ValueError(f"arrays of shapes {', '.join(map(str, shapes))}")
    return Exposure(*map(np.asarray, arrays))


def _attributes(origin: Origin) -> dict[str, Any]:
    sequence = origin.sequence
    return {
        "format": _FORMAT,
        "sensor": origin.sensor.model_dump(mode="json"),
        "exposure_s": origin.sensor.exposure_s,
        "seed": operator.index(origin.seed),
        "sequence": sequence if isinstance(sequence, str) else operator.index(sequence),
        "illuminance_lux": origin.illuminance_lux,
        "extra": dict(origin.extra),
    }


def _create_array(group: zarr.Group, name: str, frames: int, like: NDArray[Any], unit: str) -> None:
    per_chunk = max(1, _CHUNK_BYTES // max(1, like[:1].nbytes))
    group.create_array(
        name,
        shape=(frames, *like.shape[1:]),
        dtype=like.dtype,
        chunks=(min(per_chunk, max(1, frames)), *like.shape[1:]),
        dimension_names=("frame", "row", "column"),
        attributes={"unit": unit},
    )
