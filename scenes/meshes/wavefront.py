"""Objects (`o`, or `g` where there is none) of a Wavefront OBJ file, with its MTL files' materials.

trimesh passes over pictures that are missing, and over objects without a name.
"""

import re
from codecs import BOM_UTF8
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from pathlib import PurePosixPath

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Ints
from megalopta.core.bounded import check_decoded, quoted
from megalopta.core.errors import DamagedFileError
from megalopta.scenes.meshes import pieces
from megalopta.scenes.spectra.color import linear_of_srgb

_NAMING = re.compile(rb"^[ \t]*(?:mtllib|map_kd)[ \t]+([^\r\n]+)", re.IGNORECASE | re.MULTILINE)
_UNREAD = re.compile(
    rb"^[ \t]*(?!(?:v|vt|vn|f|o|g|s|usemtl|mtllib)[ \t])([a-z_]+)[ \t]",
    re.IGNORECASE | re.MULTILINE,
)
"""First words of statements that are not read."""
_SMOOTH = re.compile(rb"^[ \t]*s[ \t]+(?!off|0)", re.IGNORECASE | re.MULTILINE)
_OBJECT = re.compile(rb"^[ \t]*o[ \t]", re.MULTILINE)
_COUNTED = re.compile(rb"^[ \t]*(v|f|o|g|usemtl)[ \t]", re.MULTILINE | re.IGNORECASE)


def names_in(name: str, content: bytes) -> list[str]:
    """Names of the files that an OBJ or MTL file names, from the folder of the OBJ file."""
    if not name.lower().endswith((".obj", ".mtl")):
        return []
    lines = content.removeprefix(BOM_UTF8)
    named = (line[1].decode("utf-8", "replace") for line in _NAMING.finditer(lines))
    return [_beside(name, file.strip()) for file in named]


def stated(name: str, content: bytes) -> tuple[int, int, int]:
    """Vertices, triangles and objects of a file, at least."""
    check_decoded(name, (len(content),), pieces.TEXT_BYTES)
    lines = Counter(line[1].lower() for line in _COUNTED.finditer(content))
    return lines[b"v"], lines[b"f"], lines[b"o"] + lines[b"g"] + lines[b"usemtl"]


def _lines(content: bytes) -> Iterator[tuple[str, str]]:
    """Yield first word, in lower case, and rest of each line."""
    for line in content.decode("utf-8-sig", "replace").replace("\\\n", " ").splitlines():
        key, *values = line.split(None, 1)[:2] or [""]
        yield key.lower(), values[0].strip() if values else ""


def _beside(name: str, other: str) -> str:
    if other.startswith("-"):
        raise DamagedFileError(
            f"map_Kd {quoted(other)} in {name}: options are not supported; name the picture alone, "
            "or export as GLB"
        )
    return str(PurePosixPath(name).parent / other.replace("\\", "/"))


def pieces_of(contents: Mapping[str, bytes], used: Collection[str] = ()) -> Iterator[pieces.Piece]:
    """Yield the pieces of a file's objects, with the names alone of materials without MTL file.

    Raises any exception if the file is damaged.
    """
    name = next(iter(contents))
    faces: dict[tuple[str, str | None], list[str]] = {}
    """Faces, as written, of each object and material."""
    libraries: list[str] = []
    lists: dict[str, list[str]] = {"v": [], "vt": [], "vn": []}
    names_objects = "o" if _OBJECT.search(contents[name]) else "g"
    label, material = "", None
    for key, value in _lines(contents[name]):
        if "#" in value and (key in lists or key == "f"):
            value = value.partition("#")[0]
        if key in lists:
            lists[key].append(value)
        elif key == "f":
            face = _counted(value, [*map(len, lists.values())]) if "-" in value else value
            faces.setdefault((label, material), []).append(face)
        elif key == names_objects:
            label = value
        elif key == "usemtl":
            material = value
        elif key == "mtllib":
            libraries.append(_beside(name, value))
    positions, coordinates, normals = tables = [_table(lines) for lines in lists.values()]
    paints: dict[str | None, pieces.Paint] = {}
    pictures: dict[str, NDArray[np.float32]] = {}
    for library in filter(contents.__contains__, libraries):
        for statements in _materials(contents[library]):
            title = statements["newmtl"]
            color = linear_of_srgb(np.clip(_numbers(statements.get("kd", "1 1 1")), 0, 1))
            picture = None
            if "map_kd" in statements:
                file = _beside(library, statements["map_kd"])
                if file not in pictures:
                    pictures[file] = pieces.linear_picture(contents[file], title)
                picture = pictures[file]
            paints[title] = pieces.Paint(title, pieces.colored(color, picture))
            pieces.check_pictures(
                name, pieces.weights_of(paint.material for paint in paints.values())
            )
    numbers: dict[str, int] = {}
    for (label, material), written in faces.items():
        number = numbers.setdefault(label, len(numbers))
        corners = _corners(written)
        sizes = [len(table) + 1 for table in tables]
        if ((corners < [1, 0, 0]) | (corners >= sizes)).any():
            raise ValueError("it has faces of vertices, coordinates or normals that are not there")
        # One vertex for each combination of position, coordinates and normal.
        keys = np.ravel_multi_index(tuple(np.moveaxis(corners, -1, 0)), sizes)
        combinations, of_corner = np.unique(keys, return_inverse=True)
        place, of_uv, of_normal = (index - 1 for index in np.unravel_index(combinations, sizes))
        yield pieces.Piece(
            number,
            label or PurePosixPath(name).stem,
            positions[place, :3],
            of_corner.reshape(-1, 3),
            paints.get(material) or pieces.Paint(material),
            normals[of_normal] if (of_normal >= 0).all() else None,
            coordinates[of_uv, :2] if (of_uv >= 0).all() else None,
        )


def _table(lines: list[str]) -> Floats:
    """Numbers (n, k) of lines, as many of each as all have."""
    width = min((len(line.split()) for line in lines), default=0)
    return np.loadtxt(lines, usecols=range(width), ndmin=2) if width else np.zeros((0, 0))


def _counted(face: str, counts: list[int]) -> str:
    """A face whose negative numbers, which count back from it, count from 1 on."""

    def absolute(text: str, count: int) -> str:
        return str(int(text) + count + 1) if text.startswith("-") else text

    corners = (corner.split("/") for corner in face.split())
    return " ".join("/".join(map(absolute, corner, counts)) for corner in corners)


def _corners(faces: list[str]) -> Ints:
    """Positions, uv and normals (F, 3, 3), from 1 on, or 0, of triangles in fans of faces."""
    alike: dict[tuple[int, int, bool], list[str]] = {}
    for face in faces:
        words = face.split()
        alike.setdefault((len(words), words[0].count("/"), "//" in face), []).append(face)
    triangles = []
    for (corners, slashes, has_no_uv), lines in alike.items():
        columns = (0, 2) if has_no_uv else range(slashes + 1)
        polygons = np.zeros((len(lines), corners, 3), np.int64)
        numbers = np.loadtxt([line.replace("/", " ") for line in lines], np.int64, ndmin=2)
        polygons[..., columns] = numbers.reshape(len(lines), corners, -1)
        second = np.arange(1, corners - 1)
        fans = np.stack([np.zeros_like(second), second, second + 1], axis=1)
        triangles.append(polygons[:, fans].reshape(-1, 3, 3))
    return np.concatenate(triangles)


def _materials(content: bytes) -> list[dict[str, str]]:
    """Return the statements of each material of an MTL file, by first word."""
    materials: list[dict[str, str]] = []
    for key, value in _lines(content):
        if key == "newmtl":
            materials.append({})
        if materials:
            materials[-1][key] = value
    return materials


def unused(contents: Mapping[str, bytes], used: Collection[str] = ()) -> Iterator[pieces.Unused]:
    """Yield what has no effect. Raises any exception if the file is damaged."""
    content = next(iter(contents.values()))
    yield from (("statements", word.decode()) for word in sorted({*_UNREAD.findall(content)}))
    if b"\nvn " not in content and _SMOOTH.search(content):
        yield "smoothing groups", ""
    libraries = (file for file in contents if file.lower().endswith(".mtl"))
    for material in (each for file in libraries for each in _materials(contents[file])):
        name = material["newmtl"]
        opacity = float(material.get("d", "1").split()[-1]), 1 - float(material.get("tr", "0"))
        if min(opacity) < 1 or "map_d" in material:
            yield "transparency", name
        if _numbers(material.get("ke", "0")).any():
            yield "emission", name
        if _numbers(material.get("ks", "0")).any() or "pm" in material:
            yield "gloss and metal", name
        if (illum := material.get("illum", "2").split()[0]) not in ("0", "1", "2"):
            yield f"illum {illum}", name
        pictures = ("map_", "bump", "norm", "disp", "refl")
        for key in sorted(key for key in material if key.startswith(pictures)):
            if key not in ("map_kd", "map_d"):
                yield f"{key} pictures", name


def _numbers(text: str) -> Floats:
    return np.array(text.split()[:3], np.float64).repeat(3 if len(text.split()) == 1 else 1)
