"""Read files that may come from a stranger, within bounds. Every folder may import this module.

- A file may name a device, a pipe or something endless: only regular files are read, up to a limit.
- A few bytes can state any size: what is decoded has a budget of memory, checked before.
- A file may name what lies in its own folder, by a relative path, and nothing else. Whatever a user
  names, on the command line or in Python, is read.
- Arrays (.npy, .npz, HDF5, Zarr) hold plain numbers: nothing is unpickled, no links, virtual data,
  data in other files or filters of plug-ins are followed, and of Zarr only format 3 with codecs of
  a list, as others run code that a store contains.

The readers raise errors of any type for damage; `undamaged` makes one sentence of them.
"""

import io
import json
import math
import os
import stat
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from megalopta.core.errors import DamagedFileError, TooLargeError, UserError

if TYPE_CHECKING:
    import h5py
    import zarr
    from numpy.typing import NDArray
    from pydantic import ValidationInfo


TEXT_BYTES = 64 * 1024**2
"""Largest text file that is read, such as YAML, JSON or CSV."""
ARRAY_BYTES = 4 * 1024**3
"""Largest array or picture that is read."""
DECODED_GB = 2.0
"""Memory that the content of a file may take, unless MEGALOPTA_DECODED_GB says more."""
QUOTED = 200
"""Most characters of a value in a message."""
SENTENCE = 800
"""Most characters of a message."""
METADATA = "zarr.json"
"""Metadata that Zarr reads at once, whatever its size."""
_NUMBERS = ("bool", *(f"{kind}{bits}" for kind in ("int", "uint") for bits in (8, 16, 32, 64)))
_NUMBERS += ("float16", "float32", "float64")
_CODECS = ("bytes", "transpose", "crc32c", "blosc", "zstd", "gzip", "sharding_indexed")
_MOST_AXES, _MOST_ARRAYS, _MOST_CHUNKS = 6, 1000, 10**6


def read_bytes(path: str | Path, at_most: int = TEXT_BYTES) -> bytes:
    """Return the content of a regular file.

    Raises DamagedFileError if it is no regular file or larger than `at_most` bytes, or than the
    budget of memory. Raises OSError if it cannot be read.
    """
    check_file(path, at_most)  # before opening, which some devices act on
    # Opening a pipe without a writer would block.
    descriptor = os.open(
        path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    )
    with os.fdopen(descriptor, "rb") as file:
        status = os.fstat(file.fileno())
        check_file(path, at_most, status)
        check_decoded(path, (status.st_size,), 1)
        return file.read(status.st_size)  # no more, should it grow meanwhile


def read_text(path: str | Path, at_most: int = TEXT_BYTES) -> str:
    """Return the text of a regular file; errors as `read_bytes`, ValueError if not UTF-8."""
    try:
        return read_bytes(path, at_most).decode("utf-8")
    except UnicodeDecodeError:
        raise ValueError(f"{Path(path).name} is no text; save it as UTF-8") from None


def read_json(path: str | Path) -> Any:
    """Return the content of a JSON file; errors as `read_text`, ValueError if it is not JSON."""
    return from_json(read_text(path))


def from_json(text: str) -> Any:
    """Parse JSON text. Raises ValueError, also if it is nested too deeply or too large."""
    check_decoded("its JSON", (text.count(",") + 1,), 100)  # bytes of memory of a value
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def check_file(
    path: str | Path, at_most: int = ARRAY_BYTES, status: os.stat_result | None = None
) -> None:
    """Refuse, before a library opens it, an irregular or too large file; errors as above."""
    status = status or Path(path).stat()
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(21, "Is a directory", str(path))
    if not stat.S_ISREG(status.st_mode):
        raise DamagedFileError(f"{path}: not a regular file; give a file, not a device or pipe")
    if status.st_size > at_most:
        raise DamagedFileError(
            f"{path}: larger than {at_most / 1e6:.0f} MB, the limit for such a file"
        )


def budget_bytes() -> float:
    """Return the memory that the content of a file may take. Raises UserError."""
    setting = os.environ.get("MEGALOPTA_DECODED_GB", str(DECODED_GB))
    try:
        return float(setting) * 1e9
    except ValueError:
        raise UserError(
            f"MEGALOPTA_DECODED_GB: {quoted(setting)!r}; give a number of gigabytes, such as 4"
        ) from None


def check_decoded(path: object, shape: Iterable[int], bytes_each: float) -> None:
    """Refuse, before a reader decodes it, what takes more memory than the budget.

    `shape` is the shape that the file states, of what is in memory at once; `bytes_each` are the
    bytes of a value there, copies of the reader included. A few bytes on disk can state any shape.
    Raises TooLargeError, or UserError if the setting is no number.
    """
    budget_gb = budget_bytes() / 1e9
    sizes = [min(max(size, -1), 10**18) for size in shape]  # a file can state thousands of digits
    decoded_gb = math.prod(sizes) * bytes_each / 1e9
    if not decoded_gb <= budget_gb or min(sizes, default=0) < 0:
        raise TooLargeError(
            f"{path} takes {abs(decoded_gb):.3g} GB of memory ({' × '.join(map(str, sizes))} "
            f"values), more than {budget_gb:g} GB; shrink it, or set MEGALOPTA_DECODED_GB"
        )


def check_count(path: object, things: str, count: int, at_most: int) -> None:
    """Refuse a file that holds more things, such as nodes, than any reader is meant for.

    Raises TooLargeError.
    """
    if not 0 <= count <= at_most:
        stated = min(count, 10**18)
        raise TooLargeError(f"{path} holds {stated:,} {things}; at most {at_most:,} are read")


@contextmanager
def undamaged(path: object, remedy: str | None = None) -> Iterator[None]:
    """Raise any error of the reading inside as DamagedFileError, with path and remedy.

    Damage of a part is named after the path; damage inside of damage gets this remedy. Other errors
    for users, missing packages and lack of memory pass, and so do errors about size.
    """
    try:
        yield
    except TooLargeError:
        raise
    except DamagedFileError as problem:
        if remedy and problem.reason:
            raise DamagedFileError(f"{problem.reason}; {remedy}", problem.reason) from problem
        if str(path) in str(problem):
            raise
        raise DamagedFileError(f"{path}: {problem}") from problem
    except (UserError, ImportError, MemoryError):
        raise
    except Exception as problem:  # a damaged file can raise any exception
        reason = f"{path} is missing or damaged ({_reason(problem, path)})"
        raise DamagedFileError(f"{reason}; {remedy or 'copy it again'}", reason) from problem


def _reason(problem: Exception, path: object) -> str:
    """Return why a file cannot be read, in one line."""
    from pydantic_core import ValidationError

    if isinstance(problem, ValidationError):  # its own text has several lines, of every error
        first = problem.errors(include_url=False, include_input=False)[0]
        return quoted(": ".join([".".join(map(str, first["loc"])), first["msg"]]).strip(": "))
    reason = " ".join(str(problem).removeprefix(str(path)).lstrip(": ").split())
    lacking = "lacks " * isinstance(problem, KeyError)
    return getattr(problem, "strerror", None) or lacking + quoted(reason) or type(problem).__name__


def quoted(value: object, at_most: int = QUOTED) -> str:
    """Return a value for a message, shortened if it is long."""
    text = value if isinstance(value, str) else repr(value)
    return text if len(text) <= at_most else f"{text[:at_most]}…"


def printable(text: str) -> str:
    """Return untrusted text for a terminal, a file or a page: one line, no control codes."""
    return "".join(
        character if character.isprintable() else character.encode("unicode_escape").decode("ascii")
        for character in text
    )


def sentence(text: str, at_most: int = SENTENCE) -> str:
    """Return a message as one line with control characters escaped.

    The middle of a long message is cut: its field is at the beginning, its remedy at the end.
    """
    line = " ".join(text.split())
    line = line if line.isprintable() else printable(line)
    half = at_most // 2
    return line if len(line) <= at_most else f"{line[:half]} … {line[-half:]}"


class Typed(str):
    """Text that the user typed, such as a path on the command line: it may name any file."""


def typed(values: Any) -> Any:
    """Return plain data with every text in it as the user's."""
    if isinstance(values, Mapping):
        return {key: typed(value) for key, value in values.items()}
    if isinstance(values, list):
        return [typed(value) for value in values]
    return Typed(values) if isinstance(values, str) else values


def named_path(named: str | Path, folder: Path | None) -> Path:
    """Return the path of a file that a file in `folder` names; None: that the user names.

    Raises ValueError if it is not in that folder, after links are followed.
    """
    if folder is None or isinstance(named, Typed):
        return Path(named)
    place = folder / named
    try:
        real = place.resolve()
        is_inside = real.is_relative_to(folder.resolve()) and not real.is_symlink()
    except (OSError, RuntimeError, ValueError):  # circular links, a null byte
        is_inside = False
    if not is_inside or Path(named).is_absolute() or ":" in str(named):
        raise ValueError(
            f"{quoted(str(named))} is not in the folder of the file that names it; put it there "
            "and give its name, or name it on the command line"
        )
    return place


def folder_of(validation: "ValidationInfo") -> Path | None:
    """Return the folder of the file whose values are validated; None if the user gave them."""
    return (validation.context or {}).get("folder")


@contextmanager
def unreadable(path: str | Path) -> Iterator[None]:
    """Raise an OSError of the work inside as ValueError, a sentence with the remedy."""
    try:
        yield
    except OSError as problem:
        reason = (problem.strerror or str(problem)).lower()
        raise ValueError(f"{path} cannot be read ({reason}); give a file's path") from None


def file_content(path: str | Path, field: str) -> bytes:
    """Return the content of a file.

    Raises ValueError if it cannot be read; names the field that refers to it.
    """
    try:
        with unreadable(path):
            check_decoded(path, (Path(path).stat().st_size,), 2)
            return read_bytes(path, ARRAY_BYTES)
    except DamagedFileError as problem:
        raise ValueError(f"{field}: {problem}") from None
    except ValueError as problem:
        is_path = "\0" not in str(path)
        reason = str(problem) if is_path else f"{str(path)!r} is not a path; give a file's path"
        raise ValueError(f"{field}: {reason}") from None


def plain_array(content: bytes, kinds: str = "fiu") -> "NDArray[Any] | None":
    """Return the numbers in the content of a .npy file; None if it holds less, more or others.

    `kinds` are the possible kinds of numbers (`numpy.dtype.kind`). Nothing is unpickled, and no
    memory is allocated for numbers that are only claimed.
    """
    import numpy as np
    from numpy.lib import format as npy

    file = io.BytesIO(content)
    headers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    try:
        header = headers[npy.read_magic(file)]
        shape, is_fortran, dtype = header(file)
        if dtype.kind not in kinds:
            return None
        values = np.frombuffer(content, dtype, offset=file.tell())
        return values.reshape(shape, order="F" if is_fortran else "C").copy("K")
    except Exception:  # a damaged header can raise any exception
        return None


def mapped_array(path: Path) -> "NDArray[Any]":
    """Return the array of a .npy file, memory-mapped.

    Raises errors of any type if it is damaged, or other bytes follow, for `undamaged`.
    """
    import numpy as np

    values = np.load(path, mmap_mode="r", allow_pickle=False)
    extra = path.stat().st_size - values.offset - values.nbytes
    if extra:
        raise ValueError(f"{extra} bytes follow the array")
    return np.asarray(values)


def zipped_arrays(
    path: Path, names: Iterable[str] | None = None, kinds: str = "biuf"
) -> "dict[str, NDArray[Any]]":
    """Return arrays of an uncompressed .npz file, all by default.

    Raises errors of any type if one is missing, or the file is anything else, for `undamaged`.
    """
    check_file(path)
    arrays = {}
    with zipfile.ZipFile(path) as file:
        members = {member.filename.removesuffix(".npy"): member for member in file.infolist()}
        for name in members if names is None else names:
            if members[name].compress_type != zipfile.ZIP_STORED:
                raise ValueError(f"{name} is compressed")
            values = plain_array(file.read(members[name]), kinds)  # verifies its checksum
            if values is None:
                raise ValueError(f"{name} is no complete array of plain numbers")
            arrays[name] = values
    return arrays


@contextmanager
def opened_hdf5(path: str | Path) -> "Iterator[h5py.File]":
    """Yield an HDF5 file for `dataset_in`. Raises errors of any type, for `undamaged`."""
    import h5py

    check_file(path)
    with h5py.File(path, "r") as file:
        yield file


def is_in(file: "h5py.File", name: str) -> bool:
    """Return whether a file itself holds something at a path, without following links."""
    import h5py

    place: Any = file
    for part in name.strip("/").split("/"):
        is_group = isinstance(place, h5py.Group)
        if not is_group or not isinstance(place.get(part, getlink=True), h5py.HardLink):
            return False
        place = place[part]
    return True


def dataset_in(
    file: "h5py.File", name: str, kinds: str, axes: int, bytes_each: float, part: int | None = None
) -> "h5py.Dataset":
    """Return an array of a file that may be read.

    `kinds` are its possible kinds of numbers (`numpy.dtype.kind`); `bytes_each` are the bytes of a
    value in memory, copies of the reader included; `part` of the first axis is read at once.
    Raises ValueError if there is no such array; UserError if it takes too much memory.
    """
    import h5py

    if not is_in(file, name):
        raise ValueError(f"{name} is missing, or a link")
    data = file[name]
    if not isinstance(data, h5py.Dataset) or data.is_virtual or data.external:
        raise ValueError(f"{name} is no array of this file")
    if data.shape is None or data.ndim != axes or data.dtype.kind not in kinds:
        raise ValueError(f"{name} is {data.dtype} {data.shape}")
    created = data.id.get_create_plist()
    filters = {created.get_filter(number)[0] for number in range(created.get_nfilters())}
    built_in = {h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32}
    if strange := filters - built_in - {h5py.h5z.FILTER_LZF}:  # others are shared libraries
        raise ValueError(f"{name} needs a filter that is not built in (number {min(strange)})")
    first = data.shape[:1] if part is None else (part,)
    for shape in ((*first, *data.shape[1:]), data.chunks or ()):
        check_decoded(file.filename, shape, max(bytes_each, data.dtype.itemsize))
    return data


def numbers_in(
    file: "h5py.File", name: str, kinds: str, axes: int, bytes_each: float = 16
) -> "NDArray[Any]":
    """Read an array of a file; as `dataset_in`."""
    import numpy as np

    return np.asarray(dataset_in(file, name, kinds, axes, bytes_each)[()])


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
    import zarr
    from zarr.storage import LocalStore

    from megalopta.core.folders import check_enclosed

    check_enclosed(path)
    metadata = _metadata(path, "group")
    inside = (metadata.get("consolidated_metadata") or {}).get("metadata")
    if inside is None:
        folders = sorted(folder for folder in path.iterdir() if (folder / METADATA).exists())
        inside = {folder.name: _metadata(folder, "array") for folder in folders}
    check_count(path, "arrays", len(inside), _MOST_ARRAYS)
    for name, described in inside.items():
        if Path(name).name != name:
            raise ValueError(f"{quoted(name)!r} is no array of this store")
        _check_array(path / name, described)
    with zarr.config.set(_bounded_codecs()):
        group = zarr.open_group(LocalStore(path, read_only=True), mode="r", zarr_format=3)
        arrays = {name: group[name] for name in inside}
    return Store(dict(group.attrs), arrays)  # type: ignore[arg-type]


def _metadata(path: Path, kind: str) -> dict[str, Any]:
    """Return the metadata of a group or array of format 3."""
    if older := next(chain(path.glob(".z*"), path.glob("*/.z*")), None):
        raise ValueError(f"{older.name} is of Zarr's format 2; only format 3 is read")
    metadata = dict(read_json(path / METADATA))
    if metadata.get("zarr_format") != 3 or metadata.get("node_type") != kind:
        raise ValueError(f"{path.name} is no {kind} of Zarr's format 3")
    return metadata


def _check_array(path: Path, metadata: Mapping[str, Any]) -> None:
    """Refuse an array that is no plain numbers, or whose chunks are too large to decode."""
    if metadata.get("zarr_format") != 3 or metadata.get("node_type") != "array":
        raise ValueError(f"{path.name} is no array of Zarr's format 3")
    if metadata["data_type"] not in _NUMBERS:
        raise ValueError(f"{path.name} holds {quoted(metadata['data_type'])}, no plain numbers")
    shape, grid = metadata["shape"], metadata["chunk_grid"]
    chunk = grid["configuration"]["chunk_shape"]
    sides = [*shape, *(side - 1 for side in chunk)]
    is_plain = all(type(side) is int and 0 <= side < 2**48 for side in sides)
    if not (is_plain and 1 <= len(shape) == len(chunk) <= _MOST_AXES and grid["name"] == "regular"):
        raise ValueError(f"{path.name}: {quoted(shape)} in chunks of {quoted(chunk)} is no array")
    if metadata.get("storage_transformers"):
        raise ValueError(f"{path.name}: storage transformers are not read")
    chunks = math.prod(-(-side // step) for side, step in zip(shape, chunk, strict=True))
    if chunks > _MOST_CHUNKS:
        raise ValueError(f"{path.name} has {chunks} chunks; at most {_MOST_CHUNKS} are read")
    _check_codecs(path.name, metadata["codecs"])
    import numpy as np

    check_decoded(path, chunk, 2 * np.dtype(metadata["data_type"]).itemsize)


def _check_codecs(array: str, codecs: Any) -> None:
    """Refuse codecs that are not in the list, also inside of shards."""
    for codec in codecs:
        name = codec if isinstance(codec, str) else codec["name"]
        if name not in _CODECS:
            raise ValueError(f"{array}: codec {quoted(name)} is not one of {', '.join(_CODECS)}")
        inner = codec.get("configuration") or {} if isinstance(codec, Mapping) else {}
        for part in ("codecs", "index_codecs"):
            _check_codecs(array, inner.get(part, ()))


@cache
def _bounded_codecs() -> dict[str, str]:
    """Zarr's setting of codecs that refuse a chunk that unpacks to more than its array states."""
    from zarr import codecs
    from zarr.registry import register_codec

    bounded: tuple[tuple[str, Any, Callable[[bytes], Iterator[int]]], ...] = (
        ("blosc", codecs.BloscCodec, _stated_by_blosc),
        ("zstd", codecs.ZstdCodec, _stated_by_zstandard),
        ("gzip", codecs.GzipCodec, _unpacked_by_gzip),
    )
    names = {}
    for name, codec, sizes in bounded:

        class Bounded(codec):  # type: ignore[misc,valid-type]
            _sizes = staticmethod(sizes)

            async def _decode_single(self, chunk_bytes: Any, chunk_spec: Any) -> Any:
                expected = math.prod(chunk_spec.shape) * chunk_spec.dtype.to_native_dtype().itemsize
                for unpacked in self._sizes(chunk_bytes.to_bytes()):
                    if unpacked > 2 * expected + 2**16:  # and a checksum or two
                        raise ValueError(
                            f"a chunk of {expected} bytes unpacks to {unpacked} or more"
                        )
                return await super()._decode_single(chunk_bytes, chunk_spec)

        names[f"codecs.{name}"] = f"megalopta.{name}"
        register_codec(name, Bounded, qualname=f"megalopta.{name}")
    return names


def _stated_by_blosc(packed: bytes) -> Iterator[int]:
    yield int.from_bytes(packed[4:8], "little")


def _stated_by_zstandard(packed: bytes) -> Iterator[int]:
    """Yield the size that a frame's header states (RFC 8878, 3.1.1)."""
    kind = packed[4] if packed[:4] == b"\x28\xb5\x2f\xfd" else 0
    is_single = kind >> 5 & 1
    width = (is_single, 2, 4, 8)[kind >> 6]
    if not width:
        raise ValueError("a chunk does not state its size")
    first = 5 + (not is_single) + (0, 1, 2, 4)[kind & 3]
    yield int.from_bytes(packed[first : first + width], "little") + 256 * (width == 2)


def _unpacked_by_gzip(packed: bytes) -> Iterator[int]:
    """Yield the size so far: gzip does not state a size that can be trusted."""
    unpacked = 0
    while packed:
        member = zlib.decompressobj(wbits=31)
        while packed and not member.eof:
            unpacked += len(member.decompress(packed, 2**20))
            yield unpacked
            packed = member.unconsumed_tail
        packed = member.unused_data
