"""Triangles of a mesh file, counted before it is parsed."""

import re
from collections.abc import Mapping
from pathlib import PurePosixPath

from megalopta.scenes.meshes.gltf_file import Json, parts_of

_STL_HEADER, _STL_TRIANGLE = 84, 50
_PLY_FACES = re.compile(rb"element face (\d{1,18})\s")
_PLY_HEADER_BYTES = 2**16
_MESHES = (".obj", ".ply")


def triangles_in(contents: Mapping[str, bytes]) -> int:
    """Return the number of triangles, at least, that a file places. Raises any exception."""
    name, content = next(iter(contents.items()))
    match PurePosixPath(name).suffix.lower():
        case ".stl":
            return _of_stl(content)
        case ".ply":
            found = _PLY_FACES.search(content[:_PLY_HEADER_BYTES])
            return int(found[1]) if found else 0
        case ".xml":
            meshes = (each for each in contents.items() if each[0].lower().endswith(_MESHES))
            return sum(triangles_in({name: each}) for name, each in meshes)
        case ".obj":
            return content.count(b"\nf ")
    return _of_gltf(parts_of(content)[0])


def _of_stl(content: bytes) -> int:
    """Return the number that the size of a binary file tells, or the facets of a text."""
    stated = int.from_bytes(content[_STL_HEADER - 4 : _STL_HEADER], "little")
    is_binary = len(content) == _STL_HEADER + _STL_TRIANGLE * stated
    return stated if is_binary else content.count(b"facet normal")


def _of_gltf(header: Json) -> int:
    accessors = header.get("accessors", ())

    def of(part: Json) -> int:
        number = part.get("indices", part["attributes"]["POSITION"])
        return int(accessors[number]["count"]) // 3

    meshes = [sum(map(of, each["primitives"])) for each in header.get("meshes", ())]
    return sum(meshes[node["mesh"]] for node in header.get("nodes", ()) if "mesh" in node)
