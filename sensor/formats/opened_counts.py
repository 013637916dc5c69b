"""Stores of counts read, whole or frames at a time."""

import math
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
import zarr
from numpy.typing import NDArray
from pydantic import TypeAdapter

from megalopta.core.errors import DamagedFileError
from megalopta.core.format_numbers import check_format
from megalopta.sensor.formats.counts_store import (
    FORMAT,
    FORMAT_KEY,
    MOMENTS,
    READINGS,
    Origin,
    StoredCounts,
)
from megalopta.sensor.image_sensors import ImageSensor
from megalopta.sensor.quantities import Expectation, Exposure

_IMAGE_SENSOR: TypeAdapter[ImageSensor] = TypeAdapter(ImageSensor)
_KINDS = {"counts": "uf", "saturated": "b", **dict.fromkeys(MOMENTS, "f")}

Frames = slice | int | list[int]
T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class StoredFrames:
    """One array of a store; slicing it reads those frames, as (n, H, W)."""

    path: Path
    array: "zarr.Array[Any]"

    @classmethod
    def open(cls, path: Path, name: str) -> "StoredFrames":
        """Open one array of a Zarr group.

        Raises
        ------
        OSError, ValueError, KeyError
            When there is no such array.
        UserError
            When another version of the program wrote it, whose format this one does not read.
        """
        group = zarr.open_group(path, mode="r")
        check_format("counts", dict(group.attrs), path, FORMAT_KEY)
        return cls(path, cast("zarr.Array[Any]", group[name]))

    def __len__(self) -> int:
        """Return the number of frames."""
        return int(self.array.shape[0])

    @property
    def shape(self) -> tuple[int, ...]:
        """Frames, rows, columns."""
        return self.array.shape

    def __getitem__(self, frames: Frames) -> NDArray[Any]:
        """Read frames. Raises DamagedFileError."""
        chosen = np.asarray(frames) if isinstance(frames, list) else frames
        return _told(self.path, lambda: _finite(np.asarray(self.array.oindex[chosen])))

    def mean(self, frames_at_once: int = 64) -> float:
        """Mean over all frames, of which only so many are in memory."""
        starts = range(0, len(self), frames_at_once)
        total = sum(
            float(self[first : first + frames_at_once].sum(dtype=np.float64)) for first in starts
        )
        return total / max(self.array.size, 1)


@dataclass(frozen=True, eq=False, kw_only=True)
class OpenedCounts(Origin):
    """What made an exposure, and its frames, which are read when they are asked for.

        opened = open_counts(path)
        opened["counts"][first:last], opened["mean_reading"][first:last]

    Attributes
    ----------
    path : Path
    arrays : dict
        Name to frames: `READINGS`, where they were stored `MOMENTS`, and what else there is of
        every frame.
    """

    path: Path
    arrays: Mapping[str, StoredFrames]

    def __getitem__(self, name: str) -> StoredFrames:
        """Return one array. Raises ValueError where it was not stored."""
        if name not in self.arrays:
            raise ValueError(f"{self.path}: holds no {name}; expose with expectation=True")
        return self.arrays[name]

    def expectation(self, frames: Frames = slice(None)) -> Expectation:
        """Read the expectation of frames, by default of all."""
        return Expectation(*(self[name][frames] for name in MOMENTS))

    def exposure(self, frames: Frames = slice(None)) -> Exposure:
        """Read frames, by default all, with all arrays."""
        expectation = self.expectation(frames) if "photons" in self.arrays else None
        return Exposure(self["counts"][frames], self["saturated"][frames], expectation)


def open_counts(path: str | Path) -> OpenedCounts:
    """Open a store that `write_counts` wrote, without reading frames.

    Raises
    ------
    FileNotFoundError
        When there is nothing of this name.
    ValueError
        When it is something else, lacks a part or is damaged.
    UserError
        When another version of the program wrote it, whose format this one does not read.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such counts store")
    try:
        group = zarr.open_group(path, mode="r")
        attributes: dict[str, Any] = dict(group.attrs)
    except Exception as problem:  # of a damaged file, anything
        raise ValueError(f"{path}: not a Zarr group; give a folder of counts") from problem
    if attributes.get("format") != FORMAT:
        raise ValueError(f"{path}: a Zarr group, but not one of counts; give a folder of counts")
    check_format("counts", attributes, path, FORMAT_KEY)
    return _told(path, lambda: _opened(path, group, attributes))


def read_counts(path: str | Path) -> StoredCounts:
    """Read all frames of a store; errors as `open_counts`."""
    opened = open_counts(path)
    return StoredCounts(
        exposure=opened.exposure(),
        **{name: getattr(opened, name) for name in Origin.__dataclass_fields__},
    )


def _opened(path: Path, group: zarr.Group, attributes: dict[str, Any]) -> OpenedCounts:
    names = READINGS + MOMENTS if any(name in group for name in MOMENTS) else READINGS
    arrays: dict[str, StoredFrames] = {}
    for name in names:
        array = group[name]
        if not isinstance(array, zarr.Array) or array.dtype.kind not in _KINDS[name]:
            raise ValueError(f"{name} is no array of its kind of numbers")
        written = sum(each.is_file() for each in (path / name / "c").rglob("*"))
        sizes = zip(array.shape, array.chunks, strict=True)
        lost = math.prod(-(-size // chunk) for size, chunk in sizes) - written
        if lost > 0:
            raise ValueError(f"{lost} chunks of {name} are gone")
        arrays[name] = StoredFrames(path, array)
    shapes = [array.shape for array in arrays.values()]
    if len(shapes[0]) != 3 or len(set(shapes)) > 1:
        raise ValueError(f"arrays of shapes {', '.join(map(str, shapes))}")
    extras = {
        name: StoredFrames(path, array)
        for name, array in group.arrays()
        if name not in arrays and array.shape[0] == shapes[0][0]
    }
    return OpenedCounts(
        sensor=_IMAGE_SENSOR.validate_python(attributes["sensor"]),
        **{name: attributes[name] for name in ("seed", "sequence", "illuminance_lux", "extra")},
        path=path,
        arrays=arrays | extras,
    )


def _finite(frames: NDArray[Any]) -> NDArray[Any]:
    if frames.dtype.kind == "f" and not np.isfinite(frames).all():
        raise ValueError("not all of its numbers are finite")
    return frames


def _told(path: Path, read: Callable[[], T]) -> T:
    """What reading gives, or one sentence on what is wrong with the store."""
    try:
        return read()
    except KeyError as missing:
        raise DamagedFileError(f"{path}: lacks {missing}; write the counts again") from missing
    except Exception as problem:
        reason = textwrap.shorten(str(problem), 200)
        raise DamagedFileError(f"{path}: damaged ({reason}); write the counts again") from problem
