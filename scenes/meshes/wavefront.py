"""Meshes of a Wavefront OBJ file, with the materials of its MTL files.

Objects are those of `o`, or of `g` where there is none. Without its MTL file a material is a name.
trimesh reads OBJ, too, but passes over pictures that are missing, and over objects without a name.
"""

import re
import warnings
from codecs import BOM_UTF8
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Ints
from megalopta.core.bounded import quoted
from megalopta.core.errors import DamagedFileError
from megalopta.scenes.meshes.pieces import Paint, Piece, Texels, Unused, linear_picture
from megalopta.scenes.spectra.color import linear_of_srgb

_NAMING = re.compile(rb"^[ \t]*(?:mtllib|map_kd)[ \t]+([^\r\n]+)", re.IGNORECASE | re.MULTILINE)
_UNREAD = re.compile(
    rb"^[ \t]*(?!(?:v|vt|vn|f|o|g|s|usemtl|mtllib)[ \t])([a-z_]+)[ \t]",
    re.IGNORECASE | re.MULTILINE,
)
"""First words of statements that are not read."""
_SMOOTH = re.compile(rb"^[ \t]*s[ \t]+(?!off|0)", re.IGNORECASE | re.MULTILINE)
_OBJECT = re.compile(rb"^[ \t]*o[ \t]", re.MULTILINE)

Corners = Ints
"""(F, 3, 3): numbers, from 1 on, of position, coordinates and normal of each corner; 0: none."""


def names_in(name: str, content: bytes) -> list[str]:
    """Names of the files that an OBJ or MTL file names, from the folder of the OBJ file."""
    lines = content.removeprefix(BOM_UTF8)
    named = (found[1].decode("utf-8", "replace") for found in _NAMING.finditer(lines))
    return [_beside(name, each.strip()) for each in named]


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


def pieces_of(contents: Mapping[str, bytes], with_materials: bool = True) -> Iterator[Piece]:
    """Yield the pieces of a file's objects. Raises any exception if the file is damaged."""
    name = next(iter(contents))
    file, pictures = _ObjFile(contents[name]), dict[str, NDArray[np.float32]]()
    texels = Texels(name)
    paints = {
        paint.name: paint
        for library in (file.libraries if with_materials else ())
        if (file_name := _beside(name, library)) in contents
        for paint in _paints(file_name, contents, pictures, texels)
    }
    numbers: dict[str, int] = {}
    for (label, material), faces in file.faces.items():
        number = numbers.setdefault(label, len(numbers))
        named = label or PurePosixPath(name).stem
        paint = paints.get(material) or Paint(material, is_described=material is None)
        yield _piece(file, (number, named), _corners(faces), paint)


class _ObjFile:
    """Statements of an OBJ file."""

    def __init__(self, content: bytes) -> None:
        self.faces: dict[tuple[str, str | None], list[str]] = {}
        """Faces, as written, of each object and material."""
        self.libraries: list[str] = []
        lists: dict[str, list[str]] = {"v": [], "vt": [], "vn": []}
        names_objects = "o" if _OBJECT.search(content) else "g"
        label, material = "", None
        for key, value in _lines(content):
            if "#" in value and (key in lists or key == "f"):
                value = value.partition("#")[0]
            if key in lists:
                lists[key].append(value)
            elif key == "f":
                face = _counted(value, [*map(len, lists.values())]) if "-" in value else value
                self.faces.setdefault((label, material), []).append(face)
            elif key == names_objects:
                label = value
            elif key == "usemtl":
                material = value
            elif key == "mtllib":
                self.libraries.append(value)
        self.positions, self.uv, self.normals = (_table(each) for each in lists.values())


def _table(lines: list[str]) -> Floats:
    """Numbers (n, k) of lines, as many of each as all have."""
    width = len(lines[0].split()) if lines else 0
    with suppress(ValueError):  # unless some lines have more numbers, or words
        ended = _parsed(" nan ".join([*lines, ""]), np.float64).reshape(len(lines), width + 1)
        if np.isnan(ended[:, width]).all():
            return np.asarray(ended[:, :width])
    rows = [line.split() for line in lines]
    width = min(map(len, rows), default=0)
    return np.array([row[:width] for row in rows], np.float64).reshape(len(rows), width)


def _parsed(text: str, kind: type) -> NDArray[Any]:
    """Numbers (n,) of a text. Raises ValueError for words."""
    with warnings.catch_warnings(), suppress(ValueError, DeprecationWarning):
        warnings.simplefilter("error")  # as numpy before 2.3 only warns of words
        return np.fromstring(text, kind, sep=" ")  # ten times as fast as of words
    return np.array(text.split(), kind)


def _counted(face: str, counts: list[int]) -> str:
    """A face whose negative numbers, which count back from it, count from 1 on."""

    def absolute(text: str, count: int) -> str:
        return str(int(text) + count + 1) if text.startswith("-") else text

    corners = (corner.split("/") for corner in face.split())
    return " ".join("/".join(map(absolute, each, counts)) for each in corners)


def _corners(faces: Iterable[str]) -> Corners:
    """Triangles of faces as written, each split into a fan."""
    alike: dict[tuple[int, int, bool], list[str]] = {}
    for face in faces:
        words = face.split()
        alike.setdefault((len(words), words[0].count("/"), "//" in face), []).append(face)
    triangles = []
    for (corners, slashes, has_no_uv), lines in alike.items():
        text = " ".join(lines).replace("/", " ")
        columns = (0, 2) if has_no_uv else range(slashes + 1)
        polygons = np.zeros((len(lines), corners, 3), np.int64)
        polygons[..., columns] = _parsed(text, np.int64).reshape(len(lines), corners, -1)
        second = np.arange(1, corners - 1)
        fans = np.stack([np.zeros_like(second), second, second + 1], axis=1)
        triangles.append(polygons[:, fans].reshape(-1, 3, 3))
    return np.concatenate(triangles)


def _piece(file: _ObjFile, of: tuple[int, str], corners: Corners, paint: Paint) -> Piece:
    tables = file.positions, file.uv, file.normals
    sizes = [len(table) + 1 for table in tables]
    if ((corners < [1, 0, 0]) | (corners >= sizes)).any():
        raise ValueError("it has faces of vertices, coordinates or normals that are not there")
    # One vertex for each combination of position, coordinates and normal.
    keys = np.ravel_multi_index(tuple(np.moveaxis(corners, -1, 0)), sizes)
    chosen, faces = np.unique(keys, return_inverse=True)
    place, of_uv, of_normal = (each - 1 for each in np.unravel_index(chosen, sizes))
    uv = file.uv[of_uv, :2] if (of_uv >= 0).all() else None
    normals = file.normals[of_normal] if (of_normal >= 0).all() else None
    positions = file.positions[place]
    shaped = faces.reshape(-1, 3)
    return Piece(*of, positions[:, :3], shaped, paint, normals, uv)


def _paints(
    name: str,
    contents: Mapping[str, bytes],
    pictures: dict[str, NDArray[np.float32]],
    texels: Texels,
) -> Iterator[Paint]:
    """Yield the materials of an MTL file, and add their pictures to others."""
    for material in _materials(contents[name]):
        color = np.clip(_numbers(material.get("kd", "1 1 1")), 0, 1)
        red, green, blue = linear_of_srgb(color).tolist()
        picture = None
        if "map_kd" in material:
            file = _beside(name, material["map_kd"])
            if file not in pictures:
                pictures[file] = texels.add(linear_picture(contents[file], material["newmtl"]))
            picture = pictures[file]
        yield Paint(material["newmtl"], (red, green, blue), picture)


def _materials(content: bytes) -> list[dict[str, str]]:
    """Return the statements of each material of an MTL file, by first word."""
    materials: list[dict[str, str]] = []
    for key, value in _lines(content):
        if key == "newmtl":
            materials.append({})
        if materials:
            materials[-1][key] = value
    return materials


def unused(contents: Mapping[str, bytes], _: Collection[str] = ()) -> Iterator[Unused]:
    """Yield what has no effect. Raises any exception if the file is damaged."""
    content = next(iter(contents.values()))
    yield from (("statements", word.decode()) for word in sorted({*_UNREAD.findall(content)}))
    if b"\nvn " not in content and _SMOOTH.search(content):
        yield "smoothing groups", ""
    for file in contents:
        if file.lower().endswith(".mtl"):
            for material in _materials(contents[file]):
                yield from ((effect, material["newmtl"]) for effect in _ignored(material))


def _numbers(text: str) -> Floats:
    return np.array(text.split()[:3], np.float64).repeat(3 if len(text.split()) == 1 else 1)


def _ignored(material: Mapping[str, str]) -> Iterator[str]:
    opacity = float(material.get("d", "1").split()[-1]), 1 - float(material.get("tr", "0"))
    if min(opacity) < 1 or "map_d" in material:
        yield "transparency"
    if _numbers(material.get("ke", "0")).any():
        yield "emission"
    if _numbers(material.get("ks", "0")).any() or "pm" in material:
        yield "gloss and metal"
    if (illum := material.get("illum", "2").split()[0]) not in ("0", "1", "2"):
        yield f"illum {illum}"
    others = {key for key in material if key.startswith(("map_", "bump", "norm", "disp", "refl"))}
    yield from (f"{key} pictures" for key in sorted(others - {"map_kd", "map_d"}))
