"""Model of a mesh file: its pieces in meters, with z up."""

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from pathlib import PurePosixPath
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats
from megalopta.core.bounded import check_count, check_decoded, printable, quoted, undamaged
from megalopta.core.errors import DamagedFileError
from megalopta.core.record import Record
from megalopta.scenes.meshes import gltf, mitsuba_xml, polygons, wavefront
from megalopta.scenes.meshes.gltf import Json
from megalopta.scenes.meshes.mesh_file import REPAIR, Contents, MeshFile
from megalopta.scenes.meshes.pieces import MOST_OBJECTS, TEXT_BYTES, Piece, Unused, check_triangles
from megalopta.scenes.motion import Vector

SMALLEST_M, LARGEST_M = 1e-3, 5000.0
"""Smallest extent of a file, and the one from which it is too large, m."""

_FARTHEST_M = 1e8
"""Largest distance from the origin, m: coordinates of maps are smaller."""

_NAMED, _LONGEST = 4, 40
"""Most names in a sentence, and most characters of one"""

_Reader = Callable[[Contents], Iterable[Piece]]
_Rest = Callable[[Contents, Collection[str]], Iterable[Unused]]
_READERS: Mapping[str, tuple[_Reader, _Rest]] = {
    **dict.fromkeys((".glb", ".gltf"), (gltf.pieces_of, gltf.unused)),
    ".obj": (wavefront.pieces_of, wavefront.unused),
    ".xml": (mitsuba_xml.pieces_of, mitsuba_xml.unused),
    **dict.fromkeys((".ply", ".stl"), (polygons.pieces_of, lambda *_: ())),
}
_Y_UP = ".glb", ".gltf", ".obj", ".xml"


class PlacedMesh(Record, frozen=True):
    """Mesh file at a place, with its unit and its axes."""

    file: MeshFile
    """Path, in YAML below the file's folder, of a GLB, glTF, OBJ, PLY or STL file, or of
    Mitsuba's XML."""

    scale: Annotated[float, Field(gt=0)] = 1.0
    """Length of the file's unit (m): 0.001 for millimeters."""

    up: Literal["y", "z"] | None = None
    """Axis of the file that is up; null: y for glTF, OBJ and Mitsuba's XML, z for PLY
    and STL."""

    position_m: Vector = (0.0, 0.0, 0.0)
    """Place of the file's origin (x, y, z in m; z is up)."""

    turn_deg: Vector = (0.0, 0.0, 0.0)
    """Turns about the world's x, then y, then z (degrees)."""

    @property
    def pose(self) -> Floats:
        """Pose (4, 4) of the file's origin and axes in the world."""
        return pose_of(self.position_m, self.turn_deg)

    def triangles(self) -> int:
        """Number of triangles, without reading them; errors as `pieces`."""
        return self._counted(self.file.contents())

    def pieces(self, animated: bool = False) -> list[Piece]:
        """Return the pieces of the file, with unit normals; of glTF, perhaps animated.

        Raises ValueError if the file is damaged, changed, too large or too small.
        """
        contents = self.file.contents()
        self._counted(contents)
        with undamaged(self.file.path, REPAIR), np.errstate(all="ignore"):
            unplaced = (
                gltf.pieces_of(contents, animated)
                if animated
                else _READERS[self.file.suffix][0](contents)
            )
            placed = [piece.moved(self._axes) for piece in unplaced]
            pieces = [piece for piece in (each.sound() for each in placed) if len(piece.faces)]
        self._check(pieces)
        return pieces

    def notes(self, pieces: Iterable[Piece], *used: str) -> Iterator[str]:
        """Yield sentences on what the file holds and has no effect, if "animation" or "lights" are.

        Raises ValueError if the file is damaged or changed.
        """
        path, unused = self.file.path, dict[str, dict[str, None]]()
        with undamaged(path, REPAIR), np.errstate(all="ignore"):
            for feature, owner in _READERS[self.file.suffix][1](self.file.contents(), used):
                unused.setdefault(feature, {})[quoted(printable(owner), _LONGEST)] = None
        if unused:
            things = []
            for feature, owners in unused.items():
                names_used = [name for name in owners if name]
                unnamed = len(names_used) - _NAMED
                more = f" and {unnamed} more" if unnamed > 0 else ""
                some = f" ({', '.join(names_used[:_NAMED])}{more})" if names_used else ""
                things.append(feature + some)
            yield f"{path}: these have no effect: {quoted('; '.join(things), 600)}"
        names = {piece.material for piece in pieces if not piece.paint.is_described}
        if names:
            yield (
                f"{path}: no .mtl file next to it describes "
                f"{quoted(', '.join(sorted(names)), 400)}; such surfaces have no color, unless "
                "`materials` gives their reflectance"
            )

    @property
    def _axes(self) -> Floats:
        """Map (4, 4) from the file to meters with z up."""
        up = self.up or ("y" if self.file.suffix in _Y_UP else "z")
        axes = np.eye(4)
        axes[:3, :3] *= self.scale
        if up == "y":
            axes[:3, :3] = self.scale * np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
        return axes

    def _counted(self, contents: Contents) -> int:
        with undamaged(self.file.path, REPAIR), np.errstate(all="ignore"):
            return triangles_in(contents)

    def _check(self, pieces: list[Piece]) -> None:
        if not pieces:
            raise DamagedFileError(
                f"{self.file.path} has no triangle with an area; give a file with surfaces"
            )
        check_triangles(self.file.path, sum(len(piece.faces) for piece in pieces))
        corners = np.concatenate([piece.vertices[np.unique(piece.faces)] for piece in pieces])
        extent = min(float(np.ptp(corners, axis=0).max()), 1e300)
        if not SMALLEST_M <= extent < LARGEST_M:
            # In steps of a thousand, such as millimeters.
            step, better, fitting = 1e-3 if extent >= LARGEST_M else 1e3, self.scale, extent
            while not SMALLEST_M <= fitting < LARGEST_M:
                fitting, better = fitting * step, better * step
            raise ValueError(
                f"{self.file.path} extends over {extent:.4g} m at a scale of {self.scale:g}; give "
                f"the length of its unit in meters, such as `scale: {better:g}`"
            )
        farthest_m = float(np.abs(corners @ self.pose[:3, :3].T + self.pose[:3, 3]).max())
        if farthest_m > _FARTHEST_M:
            raise ValueError(
                f"{self.file.path} lies {farthest_m:.3g} m from the origin, beyond "
                f"{_FARTHEST_M:.0e} m; move it there"
            )


def pose_of(position_m: Vector, turn_deg: Vector) -> Floats:
    """Pose (4, 4) of a position (m) and of turns about the world's x, then y, then z (degrees)."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", turn_deg, degrees=True).as_matrix()
    pose[:3, 3] = position_m
    return pose


_LINE = re.compile(rb"^[ \t]*(v|f|o|g|usemtl)[ \t]", re.MULTILINE | re.IGNORECASE)
_MESHES = (".obj", ".ply")
_GLTF_LISTS = ("nodes", "meshes", "materials", "textures", "images", "skins", "buffers")


def triangles_in(contents: Contents) -> int:
    """Return the number of triangles, at least, that a file places.

    Raises TooLargeError if it states more than is read, and any exception if it is damaged.
    """
    name, content = next(iter(contents.items()))
    match PurePosixPath(name).suffix.lower():
        case ".stl":
            triangles = polygons.stl_triangles(content)
            vertices, objects = 3 * triangles, 1
        case ".ply":
            counts = polygons.ply_counts(content)
            vertices, triangles, objects = counts.get("vertex", 0), counts.get("face", 0), 1
        case ".xml":
            meshes = (each for each in contents.items() if each[0].lower().endswith(_MESHES))
            return sum(triangles_in({name: each}) for name, each in meshes)
        case ".obj":
            check_decoded(name, (len(content),), TEXT_BYTES)
            lines = Counter(line[1].lower() for line in _LINE.finditer(content))
            vertices, triangles = lines[b"v"], lines[b"f"]
            objects = lines[b"o"] + lines[b"g"] + lines[b"usemtl"]
        case _:
            vertices, triangles, objects = _of_gltf(name, gltf.parts_of(content)[0])
    check_count(name, "objects", objects, MOST_OBJECTS)
    check_triangles(name, triangles + vertices // 2)
    return triangles


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
