"""A counts store whose number of frames is not known beforehand, as of a camera that runs.

It opens at any moment, also after its writer was killed, with the frames of the last `publish`: an
array's own metadata may be ahead of the others', but readers take all shapes from the metadata of
the group, which is one file and replaced at once (Zarr's consolidated metadata).
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import zarr
from numpy.typing import DTypeLike, NDArray
from zarr.codecs import BloscCodec

from megalopta.core.files import write_text
from megalopta.sensor.formats.counts_store import READINGS, Origin, store_attributes, unit_of

_CHUNK_FRAMES = 4096
_CODEC = BloscCodec(cname="lz4", shuffle="bitshuffle")
"""Of readings, smaller than by Zarr's own choice, at half the computing time."""


class ExtraArray(NamedTuple):
    """An array beside the counts: its type, what its numbers are, and whether of every pixel."""

    dtype: DTypeLike
    unit: str
    of_pixels: bool = False


class GrowingCounts:
    """A new store of counts, frames appended as they come.

    Parameters
    ----------
    path : Path
        Must not exist.
    origin : Origin
    shape : (int, int)
        Rows, columns.
    extras : dict
        Further arrays by name, such as times.
    """

    def __init__(
        self, path: Path, origin: Origin, shape: tuple[int, int], extras: Mapping[str, ExtraArray]
    ) -> None:
        if path.exists():
            raise FileExistsError(f"{path}: exists already; remove it or choose another name")
        self.path = path
        self.frames = 0
        """So many are published or wait for it."""
        attributes = store_attributes(origin)
        group = zarr.open_group(path, mode="w", zarr_format=3, attributes=attributes)
        kinds = dict(zip(READINGS, (np.uint16, np.bool_), strict=True))
        arrays = {
            name: ExtraArray(kind, unit_of(name, origin.sensor), of_pixels=True)
            for name, kind in kinds.items()
        } | dict(extras)
        self._arrays = {name: _created(group, name, each, shape) for name, each in arrays.items()}
        self._chunk = {
            name: np.empty((_CHUNK_FRAMES, *array.shape[1:]), array.dtype)
            for name, array in self._arrays.items()
        }
        self._published = 0
        self.publish()

    def append(self, values: Mapping[str, NDArray[Any]]) -> None:
        """Append frames: one array (n, …) for every array of the store."""
        taken, frames = 0, len(values["counts"])
        while taken < frames:
            place = self.frames % _CHUNK_FRAMES
            some = min(_CHUNK_FRAMES - place, frames - taken)
            for name, chunk in self._chunk.items():
                chunk[place : place + some] = values[name][taken : taken + some]
            taken += some
            self.frames += some
            if self.frames % _CHUNK_FRAMES == 0:
                self.publish()

    def publish(self) -> None:
        """Make all frames so far readable."""
        first = self._published // _CHUNK_FRAMES * _CHUNK_FRAMES
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
        """Published values of one array."""
        return np.asarray(self._arrays[name][first:end])

    def rewrite(self, name: str, first: int, values: NDArray[Any]) -> None:
        """Replace published values of one array, from a frame on."""
        self._arrays[name][first : first + len(values)] = values


def _created(
    group: zarr.Group, name: str, array: ExtraArray, shape: tuple[int, int]
) -> "zarr.Array[Any]":
    pixels = shape if array.of_pixels else ()
    return group.create_array(
        name,
        shape=(0, *pixels),
        dtype=np.dtype(array.dtype),
        chunks=(_CHUNK_FRAMES, *pixels),
        dimension_names=("frame", "row", "column")[: 1 + len(pixels)],
        compressors=_CODEC,
        attributes={"unit": array.unit},
        config={"write_empty_chunks": True},
    )
