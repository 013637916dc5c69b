"""Open Zarr stores for reading: the one place that does. Every folder may import this module.

A store may come from a stranger. Its metadata are checked before Zarr sees them: format 3, arrays
of plain numbers, codecs of a list, chunks within the budget of decoded size. Format 2 and other
codecs are refused: some run code that a store contains. A compressed chunk that unpacks to more
than its array states is refused, too.
"""

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.codecs import BloscCodec, GzipCodec, ZstdCodec
from zarr.registry import register_codec
from zarr.storage import LocalStore

from megalopta.core.bounded import check_count, check_decoded, quoted, read_json
from megalopta.core.folders import check_enclosed

METADATA = "zarr.json"
_NUMBERS = ("bool", *(f"{kind}{bits}" for kind in ("int", "uint") for bits in (8, 16, 32, 64)))
_NUMBERS += ("float16", "float32", "float64")
_CODECS = ("bytes", "transpose", "crc32c", "blosc", "zstd", "gzip", "sharding_indexed")
_MOST_AXES, _MOST_ARRAYS, _MOST_CHUNKS = 6, 1000, 10**6
_LARGEST_SIDE = 2**48


@dataclass(frozen=True, eq=False)
class Store:
    """A Zarr group and its arrays, none of them decoded yet."""

    attributes: Mapping[str, Any]
    arrays: "Mapping[str, zarr.Array[Any]]"


def open_store(path: Path) -> Store:
    """Open a group of arrays.

    Raises errors of any type if it is anything else, or damaged, for `undamaged`; UserError if
    links lead out of it, or a chunk takes too much memory.
    """
    check_enclosed(path)
    said = _metadata(path, "group")
    inside = (said.get("consolidated_metadata") or {}).get("metadata")
    if inside is None:
        folders = sorted(folder for folder in path.iterdir() if (folder / METADATA).exists())
        inside = {folder.name: _metadata(folder, "array") for folder in folders}
    check_count(path, "arrays", len(inside), _MOST_ARRAYS)
    for name, described in inside.items():
        if Path(name).name != name:
            raise ValueError(f"{quoted(name)!r} is no array of this store")
        _check_array(path / name, described)
    with zarr.config.set(_BOUNDED):
        group = zarr.open_group(LocalStore(path, read_only=True), mode="r", zarr_format=3)
        arrays = {name: group[name] for name in inside}
    return Store(dict(group.attrs), arrays)  # type: ignore[arg-type]


def open_array(path: Path) -> "zarr.Array[Any]":
    """Open a store that is one array; raises as `open_store`."""
    check_enclosed(path)
    _check_array(path, _metadata(path, "array"))
    with zarr.config.set(_BOUNDED):
        return zarr.open_array(LocalStore(path, read_only=True), mode="r", zarr_format=3)


def _metadata(path: Path, kind: str) -> dict[str, Any]:
    """Return the metadata of a group or array of format 3."""
    if older := next(chain(path.glob(".z*"), path.glob("*/.z*")), None):
        raise ValueError(f"{older.name} is of Zarr's format 2; only format 3 is read")
    said = dict(read_json(path / METADATA))
    if said.get("zarr_format") != 3 or said.get("node_type") != kind:
        raise ValueError(f"{path.name} is no {kind} of Zarr's format 3")
    return said


def _check_array(path: Path, said: Mapping[str, Any]) -> None:
    """Refuse an array that is no plain numbers, or whose chunks are too large to decode."""
    if said.get("zarr_format") != 3 or said.get("node_type") != "array":
        raise ValueError(f"{path.name} is no array of Zarr's format 3")
    if said["data_type"] not in _NUMBERS:
        raise ValueError(f"{path.name} holds {quoted(said['data_type'])}, no plain numbers")
    shape, grid = said["shape"], said["chunk_grid"]
    chunk = grid["configuration"]["chunk_shape"]
    sides = [*shape, *(side - 1 for side in chunk)]
    is_plain = all(type(side) is int and 0 <= side < _LARGEST_SIDE for side in sides)
    if not (is_plain and 1 <= len(shape) == len(chunk) <= _MOST_AXES and grid["name"] == "regular"):
        raise ValueError(f"{path.name}: {quoted(shape)} in chunks of {quoted(chunk)} is no array")
    if said.get("storage_transformers"):
        raise ValueError(f"{path.name}: storage transformers are not read")
    chunks = math.prod(-(-side // step) for side, step in zip(shape, chunk, strict=True))
    if chunks > _MOST_CHUNKS:
        raise ValueError(f"{path.name} has {chunks} chunks; at most {_MOST_CHUNKS} are read")
    _check_codecs(path.name, said["codecs"])
    check_decoded(path, chunk, 2 * np.dtype(said["data_type"]).itemsize)


def _check_codecs(array: str, codecs: Any) -> None:
    """Refuse codecs that are not in the list, also inside of shards."""
    for codec in codecs:
        name = codec if isinstance(codec, str) else codec["name"]
        if name not in _CODECS:
            raise ValueError(f"{array}: codec {quoted(name)} is not one of {', '.join(_CODECS)}")
        inner = codec.get("configuration") or {} if isinstance(codec, Mapping) else {}
        for part in ("codecs", "index_codecs"):
            _check_codecs(array, inner.get(part, ()))


def _check_unpacked(unpacked: int, chunk: Any) -> None:
    """Refuse a chunk that unpacks to more than its array states, and a checksum or two."""
    expected = math.prod(chunk.shape) * chunk.dtype.to_native_dtype().itemsize
    if unpacked > 2 * expected + 2**16:
        raise ValueError(f"a chunk of {expected} bytes unpacks to {unpacked} or more")


class BoundedBlosc(BloscCodec):
    """Blosc, whose header states the size."""

    async def _decode_single(self, chunk_bytes: Any, chunk_spec: Any) -> Any:
        _check_unpacked(int.from_bytes(chunk_bytes.to_bytes()[4:8], "little"), chunk_spec)
        return await super()._decode_single(chunk_bytes, chunk_spec)


class BoundedZstd(ZstdCodec):
    """Zstandard, of which a frame's header states the size (RFC 8878, 3.1.1)."""

    async def _decode_single(self, chunk_bytes: Any, chunk_spec: Any) -> Any:
        head = chunk_bytes.to_bytes()[:18]
        kind = head[4] if head[:4] == b"\x28\xb5\x2f\xfd" else 0
        is_single = kind >> 5 & 1
        width = (is_single, 2, 4, 8)[kind >> 6]
        if not width:
            raise ValueError("a chunk does not state its size")
        first = 5 + (not is_single) + (0, 1, 2, 4)[kind & 3]
        unpacked = int.from_bytes(head[first : first + width], "little") + 256 * (width == 2)
        _check_unpacked(unpacked, chunk_spec)
        return await super()._decode_single(chunk_bytes, chunk_spec)


class BoundedGzip(GzipCodec):
    """Gzip, which is unpacked twice, as it does not state a size that can be trusted."""

    async def _decode_single(self, chunk_bytes: Any, chunk_spec: Any) -> Any:
        packed, unpacked = chunk_bytes.to_bytes(), 0
        while packed:
            member = zlib.decompressobj(wbits=31)
            while packed and not member.eof:
                unpacked += len(member.decompress(packed, 2**20))
                _check_unpacked(unpacked, chunk_spec)
                packed = member.unconsumed_tail
            packed = member.unused_data
        return await super()._decode_single(chunk_bytes, chunk_spec)


_BOUNDED = {}
for _name, _codec in (("blosc", BoundedBlosc), ("zstd", BoundedZstd), ("gzip", BoundedGzip)):
    register_codec(_name, _codec)
    _BOUNDED[f"codecs.{_name}"] = f"{_codec.__module__}.{_codec.__qualname__}"
