"""Vertices, triangles and objects of a mesh file, counted before it is parsed."""

import re
from collections import Counter
from collections.abc import Mapping
from pathlib import PurePosixPath

from megalopta.core.bounded import check_count, check_decoded
from megalopta.scenes.meshes.gltf_file import Json, parts_of
from megalopta.scenes.meshes.polygons import ply_counts, stl_triangles

MOST_OBJECTS = 10_000
"""Most objects, materials, nodes or pictures of a file."""
TRIANGLE_BYTES, _TEXT_BYTES = 300, 16
"""Memory of a triangle, or of two vertices, in a scene, and of a byte of text (measured)."""
_LINE = re.compile(rb"^[ \t]*(v|f|o|g|usemtl)[ \t]", re.MULTILINE | re.IGNORECASE)
_MESHES = (".obj", ".ply")
_GLTF_LISTS = ("nodes", "meshes", "materials", "textures", "images", "skins", "buffers")


def triangles_in(contents: Mapping[str, bytes]) -> int:
    """Return the number of triangles, at least, that a file places.

    Raises TooLargeError if it states more than is read, and any exception if it is damaged.
    """
    name, content = next(iter(contents.items()))
    match PurePosixPath(name).suffix.lower():
        case ".stl":
            triangles = stl_triangles(content)
            vertices, objects = 3 * triangles, 1
        case ".ply":
            counts = ply_counts(content)
            vertices, triangles, objects = counts.get("vertex", 0), counts.get("face", 0), 1
        case ".xml":
            meshes = (each for each in contents.items() if each[0].lower().endswith(_MESHES))
            return sum(triangles_in({name: each}) for name, each in meshes)
        case ".obj":
            check_decoded(name, (len(content),), _TEXT_BYTES)
            lines = Counter(line[1].lower() for line in _LINE.finditer(content))
            vertices, triangles = lines[b"v"], lines[b"f"]
            objects = lines[b"o"] + lines[b"g"] + lines[b"usemtl"]
        case _:
            vertices, triangles, objects = _of_gltf(name, parts_of(content)[0])
    check_count(name, "objects", objects, MOST_OBJECTS)
    check_triangles(name, triangles + vertices // 2)
    return triangles


def check_triangles(name: str, count: int) -> None:
    """Raise TooLargeError if so many triangles do not fit into the budget."""
    check_decoded(name, (count,), TRIANGLE_BYTES)


def _of_gltf(name: str, header: Json) -> tuple[int, int, int]:
    """Vertices, triangles and primitives that the nodes place, of meshes as often as placed."""
    for things in _GLTF_LISTS:
        check_count(name, things, len(header.get(things, ())), MOST_OBJECTS)
    counts = [int(each["count"]) for each in header.get("accessors", ())]
    placed = Counter(node["mesh"] for node in header.get("nodes", ()) if "mesh" in node)
    vertices = triangles = primitives = 0
    for number, times in placed.items():
        for part in header["meshes"][number]["primitives"]:
            position = part["attributes"]["POSITION"]
            corners = counts[part.get("indices", position)]
            vertices += times * counts[position]
            triangles += times * (corners // 3 if part.get("mode", 4) == 4 else corners)
            primitives += times
    return vertices, triangles, primitives
