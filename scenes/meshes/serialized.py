"""Shapes of Mitsuba's serialized files (version 4), each compressed by itself.

Mitsuba's own reader ends the process where a triangle names a vertex that is not there.
"""

import struct
import zlib
from collections.abc import Collection, Iterator, Mapping
from pathlib import PurePosixPath

import numpy as np

from megalopta.core.bounded import check_count
from megalopta.scenes.meshes.pieces import MOST_OBJECTS, Piece, Unused, check_triangles

_BEGINNING, _LONGEST_NAME = b"\x1c\x04\x04\0", 1000
_COLORS, _FLAT, _DOUBLE = 0x8, 0x10, 0x2000
_COLUMNS = (0x1, 3), (0x2, 2), (_COLORS, 3)
"""Flags and numbers a vertex of normals, uv and colors."""


def _shapes(name: str, content: bytes) -> Iterator[tuple[memoryview, str, int, int, int]]:
    """Yield compressed data, name, flags, vertices and triangles of each shape of a file.

    Raises any exception if it is damaged.
    """
    (count,) = struct.unpack_from("<I", content, len(content) - 4)
    check_count(name, "shapes", count, MOST_OBJECTS)
    size = 0
    for place in struct.unpack_from(f"<{count}Q", content, len(content) - 4 - 8 * count):
        if content[place : place + 4] != _BEGINNING:
            raise ValueError("it is no serialized file of version 4")
        packed = memoryview(content)[place + 4 :]
        head = zlib.decompressobj().decompress(packed, _LONGEST_NAME + 21)
        title = head[4:].partition(b"\0")[0]
        vertices, triangles = struct.unpack_from("<2Q", head, 5 + len(title))
        size += triangles + vertices // 2
        check_triangles(name, size)
        flags = int.from_bytes(head[:4], "little")
        yield packed, title.decode("utf-8"), flags, vertices, triangles


def pieces_of(
    contents: Mapping[str, bytes], used: Collection[str] = (), index: int | None = None
) -> Iterator[Piece]:
    """Yield the piece of each shape, or of that of an index. Raises any exception if damaged."""
    file, content = next(iter(contents.items()))
    for number, (packed, name, flags, count, triangles) in enumerate(_shapes(file, content)):
        if index not in (None, number):
            continue
        kind = np.dtype("<f8" if flags & _DOUBLE else "<f4")
        widths = [3, *(width * bool(flags & bit) for bit, width in _COLUMNS)]
        start = 21 + len(name.encode())
        end = start + count * sum(widths) * kind.itemsize
        data = zlib.decompressobj().decompress(packed, end + 12 * triangles)
        values = np.frombuffer(data, kind, count * sum(widths), start).astype(np.float64)
        columns = zip(np.split(values, count * np.cumsum(widths)[:-1]), widths, strict=True)
        vertices, normals, uv, _ = (part.reshape(-1, n) if n else None for part, n in columns)
        faces = np.frombuffer(data, "<u4", 3 * triangles, end).reshape(-1, 3).astype(np.int64)
        normals, name = None if flags & _FLAT else normals, name or PurePosixPath(file).stem
        yield Piece(number, name, np.asarray(vertices), faces, normals=normals, uv=uv)


def unused(contents: Mapping[str, bytes], used: Collection[str] = ()) -> list[Unused]:
    """Return what has no effect. Raises any exception if the file is damaged."""
    shapes = _shapes(*next(iter(contents.items())))
    return [("colors of vertices", name) for _, name, flags, *_ in shapes if flags & _COLORS]
