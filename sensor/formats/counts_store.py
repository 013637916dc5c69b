"""Counts on disk: one Zarr v3 group per sequence and sensor.

Arrays `counts`, `saturated` and, with the expectation, `photons`, `mean_events`, `events_variance`,
`mean_reading`, `reading_variance` (float32), each (frame, row, column) in chunks of whole frames,
with its unit as an attribute: counts, or electrons of an integrating sensor. The attributes of the
group hold their origin: sensor, exposure, seed, sequence, illuminance. A store is written under a
temporary name and renamed, so it is never incomplete.

A running camera's number of frames is not known beforehand. Its store can be opened at any time,
even after its writer was killed, with the frames of the last `publish`. Readers take all shapes
from the metadata of the group, one file that is replaced atomically (Zarr's consolidated metadata),
even if an array's own metadata is ahead.
"""

import json
import math
import operator
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import zarr
from numpy.typing import DTypeLike, NDArray
from pydantic import TypeAdapter
from zarr.codecs import BloscCodec

from megalopta.core.bounded import check_decoded, undamaged
from megalopta.core.files import atomic_write, write_text
from megalopta.core.format_numbers import check_format, written
from megalopta.core.zarr_store import Store, open_store
from megalopta.sensor.formats.recorded_frames import check_new
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
_CHUNK_FRAMES = 16
"""As many as the stages write at once: larger chunks would be read and written again."""
_GROWING_FRAMES = 4096
_CODEC = BloscCodec(cname="lz4", shuffle="bitshuffle")
"""For a camera's readings: smaller than Zarr's default, at half the computing time."""


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


@dataclass(frozen=True, eq=False, kw_only=True)
class StoredCounts(Origin):
    """Exposure with its origin."""

    exposure: Exposure


def write_counts(path: str | Path, stored: StoredCounts) -> None:
    """Write counts as a new store.

    Raises FileExistsError if the path exists.
    """
    with counts_writer(path, stored, len(stored.exposure.counts)) as write:
        write(stored.exposure)


@contextmanager
def counts_writer(
    path: str | Path, origin: Origin, frames: int
) -> Iterator[Callable[[Exposure], None]]:
    """Yield a function that appends frames to a new store, which appears once complete.

    Raises FileExistsError if the path exists.

    `frames`: total number of frames.
    """
    path = Path(path)
    check_new(path)
    with atomic_write(path) as temporary:
        group = _new_group(temporary, origin)
        arrays: dict[str, zarr.Array[Any]] = {}
        written = 0

        def write(exposure: Exposure) -> None:
            nonlocal written
            first, written = written, written + len(exposure.counts)
            for name, values in _arrays(exposure):
                if name not in arrays:
                    most = min(frames, _CHUNK_FRAMES, CHUNK_BYTES // max(1, values[:1].nbytes))
                    shape, unit = (frames, *values.shape[1:]), _unit(name, origin.sensor)
                    new = _created(group, name, shape, max(1, most), unit, dtype=values.dtype)
                    arrays[name] = new
                arrays[name][first : first + len(values)] = values

        yield write


def _arrays(exposure: Exposure) -> Iterator[tuple[str, NDArray[Any]]]:
    for name in READINGS:
        yield name, getattr(exposure, name)
    for name in MOMENTS if exposure.expectation else ():
        yield name, getattr(exposure.expectation, name).astype(np.float32)


def _unit(name: str, sensor: ImageSensor) -> str:
    """Description of an array's numbers."""
    event = "electrons" if sensor.unit == "electrons" else "events"
    return _MEANINGS[name].format(unit=sensor.unit, event=event)


def _new_group(path: Path, origin: Origin) -> zarr.Group:
    """Return a new group whose attributes state its origin."""
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
    return zarr.open_group(path, mode="w", zarr_format=3, attributes=said)


def format_attribute() -> dict[str, Any]:
    """Return the attribute with the format of a Zarr group."""
    return {FORMAT_KEY: written("counts")}


def _created(
    group: zarr.Group, name: str, shape: tuple[int, ...], per_chunk: int, unit: str, **how: Any
) -> "zarr.Array[Any]":
    return group.create_array(
        name,
        shape=shape,
        chunks=(per_chunk, *shape[1:]),
        dimension_names=("frame", "row", "column")[: len(shape)],
        attributes={"unit": unit},
        config={"write_empty_chunks": True},  # so that a missing chunk is not read as darkness
        **how,
    )


class ExtraArray(NamedTuple):
    """Additional array: type, description, and True if it has one value per pixel."""

    dtype: DTypeLike
    unit: str
    of_pixels: bool = False


class GrowingCounts:
    """New store of counts that grows frame by frame.

    `path`: must not exist; `shape`: rows, columns; `extras`: further arrays by name, such as times.
    """

    def __init__(
        self, path: Path, origin: Origin, shape: tuple[int, int], extras: Mapping[str, ExtraArray]
    ) -> None:
        check_new(path)
        self.path = path
        self.frames = 0
        """Frames published or pending."""
        group = _new_group(path, origin)
        readings = {
            name: ExtraArray(kind, _unit(name, origin.sensor), of_pixels=True)
            for name, kind in zip(READINGS, (np.uint16, np.bool_), strict=True)
        }
        self._arrays = {}
        for name, (dtype, unit, of_pixels) in {**readings, **extras}.items():
            none = (0, *(shape if of_pixels else ()))
            how = {"dtype": np.dtype(dtype), "compressors": _CODEC}
            self._arrays[name] = _created(group, name, none, _GROWING_FRAMES, unit, **how)
        self._chunk = {
            name: np.empty((_GROWING_FRAMES, *array.shape[1:]), array.dtype)
            for name, array in self._arrays.items()
        }
        self._published = 0
        self.publish()

    def append(self, values: Mapping[str, NDArray[Any]]) -> None:
        """Append frames: one array (n, …) for every array of the store."""
        taken, frames = 0, len(values["counts"])
        while taken < frames:
            place = self.frames % _GROWING_FRAMES
            some = min(_GROWING_FRAMES - place, frames - taken)
            for name, chunk in self._chunk.items():
                chunk[place : place + some] = values[name][taken : taken + some]
            taken += some
            self.frames += some
            if self.frames % _GROWING_FRAMES == 0:
                self.publish()

    def publish(self) -> None:
        """Make all frames so far readable."""
        first = self._published // _GROWING_FRAMES * _GROWING_FRAMES
        for name, array in self._arrays.items():
            array.resize((self.frames, *array.shape[1:]))
            if self.frames > first:
                array[first:] = self._chunk[name][: self.frames - first]
        self._published = self.frames
        whole = json.loads((self.path / "zarr.json").read_text("utf-8"))
        whole["consolidated_metadata"] = {
            "kind": "inline",
            "must_understand": False,
            "metadata": {
                name: json.loads((self.path / name / "zarr.json").read_text("utf-8"))
                for name in self._arrays
            },
        }
        write_text(self.path / "zarr.json", json.dumps(whole))

    def read(self, name: str, first: int, end: int) -> NDArray[Any]:
        """Read published values of one array."""
        return np.asarray(self._arrays[name][first:end])

    def rewrite(self, name: str, first: int, values: NDArray[Any]) -> None:
        """Replace published values of one array from a frame on."""
        self._arrays[name][first : first + len(values)] = values


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
    """Name to frames: `READINGS`, `MOMENTS` if stored, and further arrays of every frame."""

    def __getitem__(self, name: str) -> StoredFrames:
        """Return one array. Raises ValueError if it was not stored."""
        if name not in self.arrays:
            names = f"give one of {', '.join(self.arrays)}"
            remedy = "expose with expectation=True" if name in MOMENTS else names
            raise ValueError(f"{self.path}: holds no {name}; {remedy}")
        return self.arrays[name]

    def expectation(self, frames: Frames = slice(None)) -> Expectation:
        """Read the expectation of frames, by default of all."""
        return Expectation(*(self[name][frames] for name in MOMENTS))

    def exposure(self, frames: Frames = slice(None)) -> Exposure:
        """Read frames, by default all, with all arrays."""
        expectation = self.expectation(frames) if "photons" in self.arrays else None
        return Exposure(self["counts"][frames], self["saturated"][frames], expectation)


def open_counts(path: str | Path, shape: tuple[int, ...] | None = None) -> OpenedCounts:
    """Open a store written by `write_counts`, without reading frames.

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
        opened = _opened(path, store)
        if shape not in (None, found := opened["counts"].shape):
            raise ValueError(f"its arrays are {found} instead of {shape}")
        return opened


def read_counts(path: str | Path) -> StoredCounts:
    """Read all frames of a store; errors as `open_counts`."""
    opened = open_counts(path)
    return StoredCounts(
        exposure=opened.exposure(),
        **{name: getattr(opened, name) for name in Origin.__dataclass_fields__},
    )


def _opened(path: Path, store: Store) -> OpenedCounts:
    names = READINGS + MOMENTS if store.arrays.keys() & set(MOMENTS) else READINGS
    arrays: dict[str, StoredFrames] = {}
    for name in names:
        array = store.arrays[name]
        if array.dtype.kind not in _KINDS[name] or not isinstance(array.attrs.get("unit"), str):
            raise ValueError(f"{name} has the wrong type of numbers, or no unit")
        written = sum(each.is_file() for each in (path / name / "c").rglob("*"))
        sizes = zip(array.shape, array.shards or array.chunks, strict=True)
        lost = math.prod(-(-size // chunk) for size, chunk in sizes) - written
        if lost > 0:
            raise ValueError(f"{lost} chunks of {name} are missing")
        arrays[name] = StoredFrames(path, array)
    shapes = [array.shape for array in arrays.values()]
    if len(shapes[0]) != 3 or len(set(shapes)) > 1:
        raise ValueError(f"its arrays differ in shape: {', '.join(map(str, shapes))}")
    extras = {
        name: StoredFrames(path, array)
        for name, array in store.arrays.items()
        if name not in arrays and array.shape[0] == shapes[0][0]
    }
    return OpenedCounts(
        sensor=_IMAGE_SENSOR.validate_python(store.attributes["sensor"]),
        **{
            name: store.attributes[name]
            for name in ("seed", "sequence", "illuminance_lux", "extra")
        },
        path=path,
        arrays=arrays | extras,
    )
