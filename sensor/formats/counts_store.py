"""Counts on disk: one Zarr v3 group per sequence and sensor, never incomplete."""

import math
import operator
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from pydantic import TypeAdapter

from megalopta.core.bounded import check_decoded, open_store, undamaged
from megalopta.core.files import atomic_write
from megalopta.core.format_numbers import FORMATS, check_format
from megalopta.sensor.image_sensors import ImageSensor
from megalopta.sensor.quantities import Expectation, Exposure

FORMAT = "megalopta counts"
_REMEDY = "write the counts again"
FORMAT_KEY = "format_number"
"""Attribute of every Zarr group that the program writes."""
READINGS = ("counts", "saturated")
"""Arrays of every store."""
MOMENTS = ("photons", "mean_events", "events_variance", "mean_reading", "reading_variance")
"""Arrays of a store with its expectation."""

_MEANINGS = {
    "counts": "{unit} per exposure",
    "saturated": "true where the pixel was saturated",
    "photons": "mean photons on the pixel per exposure",
    "mean_events": "mean {event} per exposure",
    "events_variance": "{event}² per exposure",
    "mean_reading": "mean {unit} per exposure",
    "reading_variance": "{unit}² per exposure",
}
CHUNK_BYTES = 4 * 2**20


@dataclass(frozen=True, eq=False, kw_only=True)
class Origin:
    """Origin of an exposure."""

    sensor: ImageSensor
    seed: int
    sequence: str | int
    illuminance_lux: float | None = None
    """Light level of the scene, lux, if known."""
    extra: Mapping[str, Any] = field(default_factory=dict)
    """Further notes of the writer; JSON values."""


@contextmanager
def counts_writer(
    path: str | Path, origin: Origin, frames: int
) -> Iterator[Callable[[Exposure], None]]:
    """Yield a function that appends frames to a new store, which appears once complete.

    Raises FileExistsError if the path exists.

    `frames`: total number of frames.
    """
    path = Path(path)
    if path.exists():
        raise FileExistsError(f"{path}: already exists; remove it or choose another name")
    with atomic_write(path) as temporary:
        sequence = origin.sequence
        said = {
            "format": FORMAT,
            **format_attribute(),
            "sensor": origin.sensor.model_dump(mode="json"),
            "exposure_s": origin.sensor.exposure_s,
            "seed": operator.index(origin.seed),
            "sequence": sequence if isinstance(sequence, str) else operator.index(sequence),
            "illuminance_lux": origin.illuminance_lux,
            "extra": dict(origin.extra),
        }
        group = zarr.open_group(temporary, mode="w", zarr_format=3, attributes=said)
        arrays: dict[str, zarr.Array[Any]] = {}
        written = 0

        def write(exposure: Exposure) -> None:
            nonlocal written
            first, written = written, written + len(exposure.counts)
            values_of = {name: getattr(exposure, name) for name in READINGS}
            for name in MOMENTS if exposure.expectation else ():
                values_of[name] = getattr(exposure.expectation, name).astype(np.float32)
            for name, values in values_of.items():
                if name not in arrays:
                    # the stages write 16 frames at once: larger chunks would be written again
                    most = min(frames, 16, CHUNK_BYTES // max(1, values[:1].nbytes))
                    unit = origin.sensor.unit
                    event = "electrons" if unit == "electrons" else "events"
                    arrays[name] = group.create_array(
                        name,
                        shape=(frames, *values.shape[1:]),
                        chunks=(max(1, most), *values.shape[1:]),
                        dtype=values.dtype,
                        dimension_names=("frame", "row", "column"),
                        attributes={"unit": _MEANINGS[name].format(unit=unit, event=event)},
                        # so that a missing chunk is not read as darkness
                        config={"write_empty_chunks": True},
                    )
                arrays[name][first : first + len(values)] = values

        yield write


def format_attribute() -> dict[str, Any]:
    """Return the attribute with the format of a Zarr group."""
    return {FORMAT_KEY: FORMATS["counts"].written}


_IMAGE_SENSOR: TypeAdapter[ImageSensor] = TypeAdapter(ImageSensor)
_KINDS = {"counts": "uf", "saturated": "b", **dict.fromkeys(MOMENTS, "f")}

Frames = slice | int | list[int]


@dataclass(frozen=True, eq=False)
class StoredFrames:
    """One array of a store; slicing it reads those frames, (n, H, W)."""

    path: Path
    array: "zarr.Array[Any]"

    @classmethod
    def open(cls, path: Path, name: str) -> "StoredFrames":
        """Open one array of a Zarr group.

        Raises OSError, ValueError or KeyError if there is no such array; UserError if its format
        is one that this version of the program does not read.
        """
        store = open_store(path)
        check_format("counts", store.attributes, path, FORMAT_KEY)
        return cls(path, store.arrays[name])

    def __len__(self) -> int:
        """Return the number of frames."""
        return int(self.array.shape[0])

    @property
    def shape(self) -> tuple[int, ...]:
        """Frames, rows, columns."""
        return self.array.shape

    def __getitem__(self, frames: Frames) -> NDArray[Any]:
        """Read frames of finite numbers. Raises DamagedFileError, or UserError as `read`."""
        with undamaged(self.path, _REMEDY):
            frames_read = self.read(frames)
            if frames_read.dtype.kind == "f" and not np.isfinite(frames_read).all():
                raise ValueError("not all of its numbers are finite")
            return frames_read

    def read(self, frames: Frames) -> NDArray[Any]:
        """Read frames, of which some numbers may be NaN.

        Raises UserError if they take too much memory; errors of any type if they are damaged.
        """
        chosen = np.asarray(frames) if isinstance(frames, list) else frames
        number = 1 if isinstance(frames, int) else np.arange(len(self))[chosen].size
        check_decoded(self.path, (number, *self.shape[1:]), 2 * self.array.dtype.itemsize)
        return np.asarray(self.array.oindex[chosen])

    def mean(self) -> float:
        """Mean over all frames, reading a few at a time."""
        at_once = self.array.chunks[0]
        starts = range(0, len(self), at_once)
        total = sum(float(self[first : first + at_once].sum(dtype=np.float64)) for first in starts)
        return total / max(self.array.size, 1)


@dataclass(frozen=True, eq=False, kw_only=True)
class OpenedCounts(Origin):
    """Origin of an exposure, and its frames, read on request: `opened["counts"][first:last]`."""

    path: Path
    arrays: Mapping[str, StoredFrames]
    """Name to frames: `READINGS`, and `MOMENTS` if stored."""

    def __getitem__(self, name: str) -> StoredFrames:
        """Return one array. Raises ValueError if it was not stored."""
        if name not in self.arrays:
            names = f"give one of {', '.join(self.arrays)}"
            remedy = "expose with expectation=True" if name in MOMENTS else names
            raise ValueError(f"{self.path}: holds no {name}; {remedy}")
        return self.arrays[name]

    def exposure(self, frames: Frames = slice(None)) -> Exposure:
        """Read frames, by default all, with their expectation if it was stored."""
        arrays = {name: stored[frames] for name, stored in self.arrays.items()}
        counts, saturated = (arrays.pop(name) for name in READINGS)
        return Exposure(counts, saturated, Expectation(**arrays) if arrays else None)


def open_counts(path: str | Path, shape: tuple[int, ...] | None = None) -> OpenedCounts:
    """Open a store written by `counts_writer`, without reading frames.

    `shape` is that of its arrays, frames, rows and columns, if it is known. Raises
    FileNotFoundError if the path does not exist; ValueError if it is not a store of counts, of
    another shape, incomplete or damaged; UserError if its format is one that this version of the
    program does not read, or it takes too much memory.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such counts store")
    with undamaged(path, _REMEDY):
        store = open_store(path)
        if store.attributes.get("format") != FORMAT:
            raise ValueError(f"{path}: a Zarr group without counts; give a folder of counts")
        check_format("counts", store.attributes, path, FORMAT_KEY)
        names = READINGS + MOMENTS if store.arrays.keys() & set(MOMENTS) else READINGS
        arrays: dict[str, StoredFrames] = {}
        for name in names:
            array = store.arrays[name]
            if array.dtype.kind not in _KINDS[name] or not isinstance(array.attrs.get("unit"), str):
                raise ValueError(f"{name} has the wrong type of numbers, or no unit")
            present = sum(chunk.is_file() for chunk in (path / name / "c").rglob("*"))
            sizes = zip(array.shape, array.shards or array.chunks, strict=True)
            lost = math.prod(-(-size // chunk) for size, chunk in sizes) - present
            if lost > 0:
                raise ValueError(f"{lost} chunks of {name} are missing")
            arrays[name] = StoredFrames(path, array)
        shapes = [array.shape for array in arrays.values()]
        if len(shapes[0]) != 3 or len(set(shapes)) > 1:
            raise ValueError(f"its arrays differ in shape: {', '.join(map(str, shapes))}")
        if shape not in (None, shapes[0]):
            raise ValueError(f"its arrays are {shapes[0]} instead of {shape}")
        origin = {part.name: store.attributes[part.name] for part in fields(Origin)}
        origin["sensor"] = _IMAGE_SENSOR.validate_python(origin["sensor"])
        return OpenedCounts(**origin, path=path, arrays=arrays)
