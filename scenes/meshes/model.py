"""Model of a mesh file: its pieces in meters, with z up."""

from dataclasses import replace
from pathlib import PurePosixPath
from typing import Annotated, Literal

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats
from megalopta.core.bounded import check_count, printable, quoted, undamaged
from megalopta.core.errors import DamagedFileError
from megalopta.core.record import Record
from megalopta.scenes.meshes import gltf
from megalopta.scenes.meshes.mesh_file import FORMATS, REPAIR, MeshFile
from megalopta.scenes.meshes.pieces import MOST_OBJECTS, Piece, check_triangles
from megalopta.scenes.motion import Vector
from megalopta.scenes.scene import Lamp

SMALLEST_M, LARGEST_M = 1e-3, 5000.0
"""Smallest extent of a file, and the one from which it is too large, m."""

_FARTHEST_M = 1e8
"""Largest distance from the origin, m: coordinates of maps are smaller."""

_NAMED, _LONGEST = 4, 40
"""Most names in a sentence, and most characters of one"""

_Y_UP = ".glb", ".gltf", ".obj", ".serialized", ".xml"


class PlacedMesh(Record, frozen=True):
    """Mesh file at a place, with its unit and its axes."""

    file: MeshFile
    """Path, in YAML below the file's folder, of a GLB, glTF, OBJ, PLY or STL file, or of
    Mitsuba's XML or serialized."""
    scale: Annotated[float, Field(gt=0)] = 1.0
    """Length of the file's unit (m): 0.001 for millimeters."""
    up: Literal["y", "z"] | None = None
    """Axis of the file that is up; null: z for PLY and STL, y for all others."""
    position_m: Vector = (0.0, 0.0, 0.0)
    """Place of the file's origin (x, y, z in m; z is up)."""
    turn_deg: Vector = (0.0, 0.0, 0.0)
    """Turns about the world's x, then y, then z (degrees)."""

    @property
    def pose(self) -> Floats:
        """Pose (4, 4) of the file's origin and axes in the world."""
        return pose_of(self.position_m, self.turn_deg)

    def read(self, *used: str) -> tuple[list[Piece], list[str]]:
        """Return the pieces of the file, with unit normals, and notes on what has no effect.

        "animation" and "lights" of the file have one if used. Raises ValueError if the file is
        damaged, changed, too large or too small.
        """
        contents, path = self.file.contents(), self.file.path
        reader, unused = FORMATS[self.file.suffix], dict[str, dict[str, None]]()
        with undamaged(path, REPAIR), np.errstate(all="ignore"):
            for name, content in contents.items():
                suffix = PurePosixPath(name).suffix.lower()
                if hasattr(FORMATS.get(suffix), "stated"):
                    vertices, triangles, objects = FORMATS[suffix].stated(name, content)
                    check_count(name, "objects", objects, MOST_OBJECTS)
                    check_triangles(name, triangles + vertices // 2)
            placed = (piece.moved(self._axes).sound() for piece in reader.pieces_of(contents, used))
            pieces = [piece for piece in placed if len(piece.faces)]
            if hasattr(reader, "unused"):
                for feature, owner in reader.unused(contents, used):
                    unused.setdefault(feature, {})[quoted(printable(owner), _LONGEST)] = None
        self._check(pieces)
        notes, things = [], []
        for feature, owners in unused.items():
            named = [owner for owner in owners if owner]
            more = f" and {len(named) - _NAMED} more" if len(named) > _NAMED else ""
            things.append(feature + f" ({', '.join(named[:_NAMED])}{more})" * bool(named))
        if things:
            notes.append(f"{path}: these have no effect: {quoted('; '.join(things), 600)}")
        looks = {piece.paint.name: piece.paint.material or piece.paint.refused for piece in pieces}
        if undescribed := sorted(name for name, look in looks.items() if name and not look):
            notes.append(
                f"{path}: no .mtl file next to it describes {quoted(', '.join(undescribed), 400)}; "
                "such surfaces have no color, unless `materials` gives their reflectance"
            )
        return pieces, notes

    def lamps(self) -> list[Lamp]:
        """Return the lamps of a glTF file, in the world. Raises ValueError if it is damaged."""
        if self.file.suffix not in (".glb", ".gltf"):
            return []
        with undamaged(self.file.path, REPAIR):
            lamps = gltf.lamps_of(self.file.contents())
        return [replace(lamp, pose=self.pose @ self._axes @ lamp.pose) for lamp in lamps]

    @property
    def _axes(self) -> Floats:
        """Map (4, 4) from the file to meters with z up."""
        up = self.up or ("y" if self.file.suffix in _Y_UP else "z")
        axes = np.eye(4)
        axes[:3, :3] *= self.scale
        if up == "y":
            axes[:3, :3] = self.scale * np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
        return axes

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
