"""Meshes of a scene in Mitsuba's XML: every shape is an object, every surface a material.

Shapes are meshes of OBJ and PLY files, and Mitsuba's basic ones, as triangles. Area lights shine on
request. What else would change the picture is refused by name, cameras and integrators of the file
have no effect.
"""

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import PurePosixPath
from typing import NamedTuple

import numpy as np

from megalopta.core.arrays import Floats, Ints
from megalopta.core.bounded import check_count, quoted
from megalopta.core.errors import DamagedFileError
from megalopta.scenes.meshes import polygons, wavefront
from megalopta.scenes.meshes.mitsuba_surfaces import Surfaces, content_of
from megalopta.scenes.meshes.pieces import MOST_OBJECTS, Piece, Unused, check_triangles
from megalopta.scenes.meshes.xml_document import (
    Document,
    Element,
    numbers_in,
    plain,
    transform_of,
    value_of,
)

_FILES = ("obj", "ply")
_UNUSED = "emitter", "film", "integrator", "medium", "phase", "sensor", "volume"
"""Parts of scenes that have no effect"""
_OF_SHAPES = ("bsdf", "emitter", "medium", "sensor", "shape", "transform")
_VALUES = ("boolean", "float", "integer", "point", "string", "vector")
"""Parts of shapes that are read, refused by their material, or change nothing that is seen"""


def names_in(content: bytes) -> list[str]:
    """Names of the files of shapes and of their surfaces."""
    names = []
    for element in Document(content).root.iter():
        if element.tag == "texture" or (element.tag == "shape" and element.get("type") in _FILES):
            names.append(value_of(element, "string", "filename"))
        elif element.tag == "spectrum":
            names.append(element.get("filename", ""))
    return [plain(name) for name in names if name]


def pieces_of(contents: Mapping[str, bytes]) -> Iterator[Piece]:
    """Yield the pieces of all shapes. Raises any exception if the file is damaged."""
    reader, total = _Reader(contents), 0
    for number, shape in enumerate(reader.document.parts(reader.document.root, "shape")):
        check_count(next(iter(contents)), "shapes", number + 1, MOST_OBJECTS)
        for piece in reader.painted(shape, number):
            total += len(piece.faces)
            check_triangles(next(iter(contents)), total)
            yield piece.moved(transform_of(shape))


def unused(contents: Mapping[str, bytes], used: Collection[str] = ()) -> Iterator[Unused]:
    """Yield what has no effect, if "lights" are used or not. Raises any exception."""
    document = Document(next(iter(contents.values())))
    for part in document.root:
        is_lamp = part.tag == "emitter" and part.get("type") == "area"  # of shapes that name it
        if part.tag in _UNUSED and not is_lamp:
            yield f"{part.tag}s", part.get("type", "")
    for shape in document.root.iter("shape"):
        name = shape.get("id", shape.get("type", ""))
        if document.parts(shape, "emitter") and "lights" not in used:
            yield "lamps, as lights are 'own'", name
        if document.parts(shape, "sensor"):
            yield "sensors", name


def check_lights(contents: Mapping[str, bytes]) -> None:
    """Raise DamagedFileError for a light that does not belong to a shape, and is not read."""
    document = Document(next(iter(contents.values())))
    for light in document.parts(document.root, "emitter"):
        kind = light.get("type", "")
        if kind != "area":  # which shines where a shape refers to it
            raise DamagedFileError(
                f"lights 'file': an emitter of type {quoted(kind)!r} is not rendered; remove it, "
                "or use 'own' with the configuration's light"
            )


class _Reader:
    """Reads the shapes of one document."""

    def __init__(self, contents: Mapping[str, bytes]) -> None:
        self._contents = contents
        self.document = Document(next(iter(contents.values())))
        self._surfaces = Surfaces(self.document, contents)

    def painted(self, shape: Element, number: int) -> Iterator[Piece]:
        """Yield the pieces of a shape with its surface, before its pose, with its number."""
        kind, file = shape.get("type", ""), plain(value_of(shape, "string", "filename"))
        name = shape.get("id") or PurePosixPath(file).stem or kind
        for part in map(self.document.resolved, shape):
            if part.tag not in _OF_SHAPES + _VALUES:
                raise DamagedFileError(
                    f"shape {quoted(name)!r} has a part {quoted(part.tag)!r}, which is not read; "
                    "remove it"
                )
        paint, to_picture = self._surfaces.of(shape, name)
        if self.document.parts(shape, "medium"):
            paint = replace(paint, finish=None, refused="the boundary of a medium")
        if self.document.parts(shape, "emitter"):
            paint = self._surfaces.shining(paint, shape)
        is_flat, is_flipped = (
            value_of(shape, "boolean", f"{name}_normals") == "true" for name in ("face", "flip")
        )
        pieces = [*self._of_file(kind, file)] if kind in _FILES else [_basic(kind, shape)]
        if not any(len(piece.faces) for piece in pieces):
            raise ValueError(f"{quoted(file)} has no triangles")
        for piece in pieces:
            uv = piece.uv
            if uv is not None and not paint.finish:
                uv = uv @ to_picture[:2, :2].T + to_picture[:2, 2]
                uv = uv * [1, -1] + [0, 1]  # Mitsuba's first row is v = 0, here the last one
            normals = None if is_flat else piece.normals
            faces = piece.faces[:, ::-1] if is_flipped else piece.faces
            piece = replace(piece, name=name, paint=paint, faces=faces)
            yield replace(piece, number=number, normals=normals, uv=uv)

    def _of_file(self, kind: str, file: str) -> Iterator[Piece]:
        """Yield pieces of a mesh file, with Mitsuba's texture coordinates."""
        content = {f"{PurePosixPath(file).stem}.{kind}": content_of(self._contents, file)}
        if kind == "ply":
            yield from polygons.pieces_of(content)
            return
        for piece in wavefront.pieces_of(content, with_materials=False):
            uv = None if piece.uv is None else piece.uv * [1, -1] + [0, 1]
            yield replace(piece, uv=uv)


def _basic(kind: str, shape: Element) -> Piece:
    """Return one of Mitsuba's own shapes. Raises ValueError for others."""
    points = {
        each.get("name"): np.array([float(each.get(axis, "0")) for axis in "xyz"])
        if "value" not in each.attrib
        else numbers_in(each.attrib["value"])
        for each in shape
        if each.tag in ("point", "vector")
    }
    radius, label = float(value_of(shape, "float", "radius") or 1), shape.get("id") or kind
    if not 0 < radius < math.inf:
        raise ValueError(f"shape {quoted(label)!r} has radius {radius:g}, which is not above 0")
    match kind:
        case "rectangle":
            made = rectangle()
        case "cube":
            made = cube()
        case "disk":
            made = disk()
        case "sphere":
            made = sphere(points.get("center", np.zeros(3)), radius)
        case "cylinder":
            start, end = points.get("p0", np.zeros(3)), points.get("p1", np.array([0, 0, 1.0]))
            if not 0 < np.linalg.norm(end - start) < math.inf:
                raise ValueError(f"shape {quoted(label)!r} has p0 {start} and p1 {end}: no length")
            made = cylinder(start, end, radius)
        case _:
            raise DamagedFileError(
                f"a shape of type {quoted(kind)!r} is not read; export it as PLY or OBJ"
            )
    return Piece(0, kind, made.vertices, made.faces, normals=made.normals, uv=made.uv)


_ROUND = 96
"""Sides of round shapes: facets are up to 1.1e-3 of the radius below a sphere."""


class Shape(NamedTuple):
    """Triangles of a shape, with smooth normals if it is round."""

    vertices: Floats
    """(V, 3)."""
    faces: Ints
    """(F, 3)."""
    uv: Floats | None = None
    """(V, 2), as Mitsuba's."""
    normals: Floats | None = None
    """(V, 3)."""


def rectangle() -> Shape:
    """Return a square of side 2 with normal +z."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    return Shape(corners, np.array([[0, 1, 2], [0, 2, 3]]), (corners[:, :2] + 1) / 2)


def cube() -> Shape:
    """Return a cube of side 2, without texture coordinates."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1.0)])
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [[side[0], side[n], side[n + 1]] for side in sides for n in (1, 2)]
    return Shape(corners, np.array(faces))


def disk() -> Shape:
    """Return a disk of radius 1 with normal +z, without texture coordinates."""
    rim = _circle()[:-1]
    vertices = np.concatenate([np.zeros((1, 3)), np.column_stack([rim, np.zeros(_ROUND)])])
    around = np.arange(_ROUND)
    faces = np.column_stack([np.zeros(_ROUND, int), around + 1, (around + 1) % _ROUND + 1])
    return Shape(vertices, faces)


def sphere(center: Floats, radius: float) -> Shape:
    """Return a sphere about a center (3,)."""
    polar = np.linspace(0, np.pi, _ROUND // 2 + 1)
    ring = _circle()
    normals = np.stack(
        [
            np.outer(np.sin(polar), ring[:, 0]),
            np.outer(np.sin(polar), ring[:, 1]),
            np.repeat(np.cos(polar)[:, None], len(ring), axis=1),
        ],
        axis=-1,
    )
    turn, fall = np.meshgrid(np.linspace(0, 1, len(ring)), polar / np.pi)
    uv = np.stack([turn, fall], axis=-1).reshape(-1, 2)
    flat = normals.reshape(-1, 3)
    return Shape(center + radius * flat, _grid(*normals.shape[:2])[:, ::-1], uv, flat)


def cylinder(start: Floats, end: Floats, radius: float) -> Shape:
    """Return an open cylinder between two points (3,), without texture coordinates."""
    axis = (end - start) / np.linalg.norm(end - start)
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    across /= np.linalg.norm(across)
    normals = _circle() @ np.stack([across, np.cross(axis, across)])
    vertices = np.concatenate([start + radius * normals, end + radius * normals])
    return Shape(vertices, _grid(2, len(normals)), None, np.concatenate([normals, normals]))


def _circle() -> Floats:
    """Points (n + 1, 2) around the unit circle; the last is the first again."""
    angle = np.linspace(0, 2 * np.pi, _ROUND + 1)
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _grid(rows: int, columns: int) -> Ints:
    """Two triangles (F, 3) for each cell of a grid of vertices."""
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b = number[:-1, :-1].ravel(), number[:-1, 1:].ravel()
    c, d = number[1:, 1:].ravel(), number[1:, :-1].ravel()
    return np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
