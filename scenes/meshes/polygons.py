"""Meshes of STL and PLY files, which trimesh reads: one object, without colors."""

import io
import re
from collections.abc import Collection, Mapping
from pathlib import PurePosixPath

import numpy as np

from megalopta.core.errors import DamagedFileError
from megalopta.scenes.meshes.pieces import Piece

_HEADER_BYTES = 2**16
_PLY_BYTES = {
    **dict.fromkeys(("char", "uchar", "int8", "uint8"), 1),
    **dict.fromkeys(("short", "ushort", "int16", "uint16"), 2),
    **dict.fromkeys(("int", "uint", "int32", "uint32", "float", "float32"), 4),
    **dict.fromkeys(("double", "float64"), 8),
}
_STL_HEADER = 84


def stated(name: str, content: bytes) -> tuple[int, int, int]:
    """Vertices, triangles and objects that a file states. Raises ValueError if it is too short."""
    if name.lower().endswith(".ply"):
        counts = _ply_counts(content)
        return counts.get("vertex", 0), counts.get("face", 0), 1
    triangles = int.from_bytes(content[_STL_HEADER - 4 : _STL_HEADER], "little")
    if len(content) != _STL_HEADER + 50 * triangles:  # bytes of a triangle
        if not content.lstrip()[:5].lower() == b"solid":
            raise ValueError(
                f"it states {triangles} triangles, which do not fit its {len(content)} bytes"
            )
        if not content.rstrip().rpartition(b"\n")[2].lstrip().lower().startswith(b"endsolid"):
            raise ValueError("it ends early, without endsolid")
        triangles = content.lower().count(b"endfacet")
    return 3 * triangles, triangles, 1


def pieces_of(contents: Mapping[str, bytes], used: Collection[str] = ()) -> list[Piece]:
    """Return the piece of a file. Raises any exception if the file is damaged."""
    import trimesh  # slow

    name, content = next(iter(contents.items()))
    path, header = PurePosixPath(name), content[:_HEADER_BYTES]
    kind = path.suffix.lower().removeprefix(".")
    if kind == "ply" and b"comment TextureFile" in header:
        raise DamagedFileError(
            "it names a picture, which PLY has no standard for; export it as GLB"
        )
    mesh = trimesh.load_mesh(io.BytesIO(content), file_type=kind, process=False)
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
    if kind == "stl":
        return [Piece(0, path.stem, vertices, faces)]
    smooth = re.search(rb"property \w+ nx\s", header)
    normals = np.asarray(mesh.vertex_normals, np.float64) if smooth else None
    uv = getattr(mesh.visual, "uv", None)
    return [Piece(0, path.stem, vertices, faces, normals=normals, uv=uv)]


def _ply_counts(content: bytes) -> dict[str, int]:
    """Number of each element that a PLY file states; ValueError if it is too short for them."""
    header, ends, body = content.partition(b"end_header")
    if not ends:
        raise ValueError("its header does not end")
    counts: dict[str, int] = {}
    needed, name = 0, ""
    for line in header.decode("utf-8", "replace").splitlines():
        match line.split():
            case ["element", name, count]:
                counts[name] = int(count)
            case ["property", "list", length, index, _]:
                corners = 3 * _PLY_BYTES[index] if name == "face" else 0
                needed += counts[name] * (_PLY_BYTES[length] + corners)
            case ["property", kind, _]:
                needed += counts[name] * _PLY_BYTES[kind]
    size, unit = len(body), "bytes"
    if b"format ascii" in header:
        needed, size, unit = sum(counts.values()), body.strip().count(b"\n") + 1, "lines"
        last = body.rstrip().rpartition(b"\n")[2].split()
        if name == "face" and counts[name] and len(last) <= int(last[0]):
            raise ValueError("it ends within a face")
    if needed > size or min(counts.values(), default=0) < 0:
        raise ValueError(f"it states {counts}, for which its {size} {unit} are too few")
    return counts
