"""Scene in Mitsuba's XML: every shape, of a mesh file or basic, as an object of triangles.

What else would change the picture is refused by name; cameras and integrators have no effect.
"""

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from pathlib import PurePosixPath

import numpy as np

from megalopta.assets_gen import grid_faces
from megalopta.core.bounded import check_count, quoted
from megalopta.core.errors import DamagedFileError
from megalopta.scenes.meshes import polygons, serialized, wavefront, xml_document as xml
from megalopta.scenes.meshes.mitsuba_surfaces import Surfaces, content_of
from megalopta.scenes.meshes.pieces import MOST_OBJECTS, Piece, Unused, check_triangles

_FILES = {"obj": wavefront, "ply": polygons, "serialized": serialized}
_UNUSED = "emitter", "film", "integrator", "medium", "phase", "sensor", "volume"
"""Parts of scenes that have no effect"""
_OF_SHAPES = ("bsdf", "emitter", "medium", "sensor", "shape", "transform")
_VALUES = ("boolean", "float", "integer", "point", "string", "vector")
"""Parts of shapes that are read, refused by their material, or change nothing that is seen"""


def names_in(name: str, content: bytes) -> list[str]:
    """Names of the files of shapes and of their surfaces."""
    names = []
    for element in xml.Document(content).root.iter() if name.lower().endswith(".xml") else ():
        if element.tag == "texture" or (element.tag == "shape" and element.get("type") in _FILES):
            names.append(xml.value_of(element, "string", "filename"))
        elif element.tag == "spectrum":
            names.append(element.get("filename", ""))
    return [xml.plain(name) for name in names if name]


def pieces_of(contents: Mapping[str, bytes], used: Collection[str] = ()) -> Iterator[Piece]:
    """Yield the pieces of all shapes. Raises any exception if the file is damaged.

    If "lights" are used, area lights shine, and others are refused.
    """
    owner, total = next(iter(contents)), 0
    document = xml.Document(contents[owner])
    for light in document.parts(document.root, "emitter") if "lights" in used else ():
        if (kind := light.get("type", "")) != "area":  # which shines where a shape refers to it
            raise DamagedFileError(
                f"lights 'file': an emitter of type {quoted(kind)!r} is not rendered; remove it, "
                "or use 'own' with the configuration's light"
            )
    surfaces = Surfaces(document, contents)
    for number, shape in enumerate(document.parts(document.root, "shape")):
        check_count(owner, "shapes", number + 1, MOST_OBJECTS)
        for piece in _painted(document, contents, surfaces, shape, "lights" in used):
            total += len(piece.faces)
            check_triangles(owner, total)
            yield replace(piece, number=number).moved(xml.transform_of(shape))


def unused(contents: Mapping[str, bytes], used: Collection[str] = ()) -> Iterator[Unused]:
    """Yield what has no effect, if "lights" are used or not. Raises any exception."""
    document = xml.Document(next(iter(contents.values())))
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


def _painted(
    document: xml.Document,
    contents: Mapping[str, bytes],
    surfaces: Surfaces,
    shape: xml.Element,
    shines: bool,
) -> Iterator[Piece]:
    """Yield the pieces of a shape with its surface, before its pose."""
    kind, file = shape.get("type", ""), xml.plain(xml.value_of(shape, "string", "filename"))
    name = shape.get("id") or PurePosixPath(file).stem or kind
    for part in map(document.resolved, shape):
        if part.tag not in _OF_SHAPES + _VALUES:
            raise DamagedFileError(
                f"shape {quoted(name)!r} has a part {quoted(part.tag)!r}, which is not read; "
                "remove it"
            )
    paint, to_picture = surfaces.of(shape, name)
    if document.parts(shape, "medium"):
        paint = replace(paint, material=None, refused="the boundary of a medium")
    if shines and document.parts(shape, "emitter"):
        paint = replace(paint, radiance=surfaces.radiance(shape, name))
    is_flat, is_flipped = (
        xml.value_of(shape, "boolean", f"{name}_normals") == "true" for name in ("face", "flip")
    )
    if kind in _FILES:
        content = {f"{PurePosixPath(file).stem}.{kind}": content_of(contents, file)}
        index = {"index": int(xml.value_of(shape, "integer", "shape_index") or 0)}
        pieces = [*_FILES[kind].pieces_of(content, **index if kind == "serialized" else {})]
    else:
        pieces = [_basic(kind, shape)]
    if not any(len(piece.faces) for piece in pieces):
        raise ValueError(f"{quoted(file)} has no triangles, or no shape of its shape_index")
    has_finish = paint.material is not None and paint.material.finish is not None
    for piece in pieces:
        uv = piece.uv
        if uv is not None:
            if kind == "obj":
                uv = uv * [1, -1] + [0, 1]  # its first row is v = 1, Mitsuba's is v = 0
            if not has_finish:
                uv = uv @ to_picture[:2, :2].T + to_picture[:2, 2]
                uv = uv * [1, -1] + [0, 1]
        normals = None if is_flat else piece.normals
        faces = piece.faces[:, ::-1] if is_flipped else piece.faces
        yield replace(piece, name=name, paint=paint, faces=faces, normals=normals, uv=uv)


_ROUND = 96
"""Sides of round shapes: facets are up to 1.1e-3 of the radius below a sphere."""


def _basic(kind: str, shape: xml.Element) -> Piece:
    """Return one of Mitsuba's own shapes, with its uv. Raises ValueError for others."""
    points = {
        element.get("name"): np.array([float(element.get(axis, "0")) for axis in "xyz"])
        if "value" not in element.attrib
        else xml.numbers_in(element.attrib["value"])
        for element in shape
        if element.tag in ("point", "vector")
    }
    import trimesh  # slow

    radius, label = float(xml.value_of(shape, "float", "radius") or 1), shape.get("id") or kind
    if not 0 < radius < math.inf:
        raise ValueError(f"shape {quoted(label)!r} has radius {radius:g}, which is not above 0")
    rows = 1 + (_ROUND // 2 if kind == "sphere" else 1)
    turn, along = np.meshgrid(np.linspace(0, 1, _ROUND + 1), np.linspace(0, 1, rows))
    circle = np.stack([np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)], axis=-1)
    faces, uv = grid_faces(rows, _ROUND + 1), np.dstack([turn, along]).reshape(-1, 2)
    match kind:
        case "rectangle":
            corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
            uv = (corners[:, :2] + 1) / 2
            return Piece(0, kind, corners, np.array([[0, 1, 2], [0, 2, 3]]), uv=uv)
        case "cube":
            cube = trimesh.creation.box((2, 2, 2))
            return Piece(0, kind, np.array(cube.vertices), np.array(cube.faces))
        case "disk":
            corners = np.dstack([along[..., None] * circle, 0 * turn]).reshape(-1, 3)
            return Piece(0, kind, corners, faces[:, ::-1], uv=uv[:, ::-1])
        case "sphere":
            across = np.sin(np.pi * along)[..., None] * circle
            normals = np.dstack([across, np.cos(np.pi * along)]).reshape(-1, 3)
            vertices = points.get("center", np.zeros(3)) + radius * normals
            return Piece(0, kind, vertices, faces[:, ::-1], normals=normals, uv=uv)
        case "cylinder":
            start, end = points.get("p0", np.zeros(3)), points.get("p1", np.array([0, 0, 1.0]))
            axis = end - start
            if not 0 < np.linalg.norm(axis) < math.inf:
                raise ValueError(f"shape {quoted(label)!r} has p0 {start} and p1 {end}: no length")
            side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
            side /= np.linalg.norm(side)
            normals = circle @ np.stack([side, np.cross(axis / np.linalg.norm(axis), side)])
            vertices = start + along[..., None] * axis + radius * normals
            smooth = normals.reshape(-1, 3)
            return Piece(0, kind, vertices.reshape(-1, 3), faces, normals=smooth, uv=uv)
    raise DamagedFileError(f"a shape of type {quoted(kind)!r} is not read; export it as PLY or OBJ")
