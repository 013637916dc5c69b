"""Meshes of PLY and STL files, which trimesh reads: one object, colors of vertices or faces."""

import io
import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.core.errors import DamagedFileError
from megalopta.scenes.meshes.pieces import Piece, Unused, stated_unit
from megalopta.scenes.spectra.color import decode_srgb

if TYPE_CHECKING:
    import trimesh

_HEADER_BYTES = 2**16
_PROPERTIES = (
    *("x", "y", "z", "nx", "ny", "nz", "red", "green", "blue"),
    *("u", "v", "s", "t", "vertex_indices", "vertex_index"),
)


def pieces_of(contents: Mapping[str, bytes]) -> list[Piece]:
    """Return the piece of a file. Raises any exception if the file is damaged."""
    import trimesh  # slow

    name, content = next(iter(contents.items()))
    path = PurePosixPath(name)
    if b"comment TextureFile" in content[:_HEADER_BYTES]:
        raise DamagedFileError(
            "it names a picture, which PLY has no standard for; export it as GLB"
        )
    kind = path.suffix.lower().removeprefix(".")
    mesh = trimesh.load_mesh(io.BytesIO(content), file_type=kind, process=False)
    smooth = re.search(rb"property \w+ nx\s", content[:_HEADER_BYTES]) and kind == "ply"
    normals = np.asarray(mesh.vertex_normals, np.float64) if smooth else None
    vertices, faces = np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64)
    uv = getattr(mesh.visual, "uv", None)
    piece = Piece(0, path.stem, vertices, faces, normals=normals, uv=uv, colors=_colors(mesh))
    return [piece]


def unused(contents: Mapping[str, bytes], _: Collection[str] = ()) -> Iterator[Unused]:
    """Yield what has no effect. Raises any exception if the file is damaged."""
    name, content = next(iter(contents.items()))
    yield from stated_unit(content)
    if name.lower().endswith(".ply"):
        for line in content[:_HEADER_BYTES].partition(b"end_header")[0].splitlines():
            key, *words = line.decode("utf-8", "replace").split() or [""]
            if key == "element" and words[0] not in ("vertex", "face"):
                yield "elements", words[0]
            if key == "property" and words[-1] not in _PROPERTIES:
                yield "properties", words[-1]
    elif content[:5].lower() != b"solid":
        facets = np.frombuffer(content[84:], np.uint8)
        if facets[: len(facets) // 50 * 50].reshape(-1, 50)[:, 48:].any():
            yield "attributes of facets, such as colors", ""


def _colors(mesh: "trimesh.Trimesh") -> Floats | None:
    """Colors of vertices, or of the corners of faces, in linear sRGB."""
    if mesh.visual.kind == "vertex":
        return decode_srgb(np.asarray(mesh.visual.vertex_colors)[:, :3])
    if mesh.visual.kind == "face":
        return decode_srgb(np.asarray(mesh.visual.face_colors)[:, None, :3].repeat(3, axis=1))
    return None
