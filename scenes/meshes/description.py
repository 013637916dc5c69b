"""Scene of the user's own mesh files, with an object for each mesh that a node places."""

from collections.abc import Iterable, Mapping
from pathlib import PurePath
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from megalopta.assets_gen import Surface
from megalopta.core.bounded import printable, quoted
from megalopta.scenes.base import SceneDescription
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.light import Light
from megalopta.scenes.material import Material
from megalopta.scenes.meshes.model import PlacedMesh
from megalopta.scenes.meshes.pieces import Piece, check_pictures, check_triangles, weights_of
from megalopta.scenes.meshes.reflectance import Reflectance, Share, material_of
from megalopta.scenes.meshes.surfaces import Surfacing, check_names
from megalopta.scenes.scene import Asset, Placement, Scene
from megalopta.scenes.trajectories.base import Path

_GROUND = "ground"


class SceneFile(PlacedMesh, frozen=True):
    """Mesh file of a scene."""

    animate: bool = False
    """True to move nodes by the first animation of a glTF file, which starts at time 0."""

    @model_validator(mode="after")
    def _can_move(self) -> "SceneFile":
        if self.animate and self.file.suffix not in (".glb", ".gltf"):
            raise ValueError(f"animate: {self.file.path} is no glTF file; omit it")
        return self


_by_path = BeforeValidator(lambda it: {"file": it} if isinstance(it, str | PurePath) else it)
_as_list = BeforeValidator(lambda it: [it] if isinstance(it, str | PurePath | Mapping) else it)


class Meshes(SceneDescription, frozen=True):
    """Your own scene, from files of meshes."""

    kind: Literal["meshes"] = "meshes"
    is_made_for_camera: ClassVar[bool] = False
    max_depth: ClassVar[int] = 64  # a closed white room of albedo 0.8 lacks 3 % of its light at 16
    files: Annotated[
        tuple[Annotated[SceneFile, _by_path], ...], _as_list, Field(min_length=1, max_length=1000)
    ]
    """Mesh files: paths, or mappings with `file` and its scale, axes and place."""
    materials: dict[str, Reflectance] = Field(
        default={},
        description="Reflectances in place of colors, by the name of a material, or of an object "
        "without one: a number, the same at every wavelength (1); a CSV file with "
        "wavelength_nm,reflectance; or the name of a surface of forests.",
    )
    reflectance: Share = 0.5
    """Reflectance, the same at every wavelength, of surfaces that have no color in their file
    (1)."""
    lights: Literal["own", "file"] = Field(default="own", exclude_if=lambda lights: lights == "own")
    """Light on the scene. own: the configuration's `light`. file: only the area lights of Mitsuba's
    XML, and the lamps and emission of glTF; `light.level` then names their level, from which other
    levels are scaled."""
    ground: Reflectance | None = None
    """Reflectance of a level ground below all files, as in `materials`; null: no ground."""

    @property
    def is_self_luminous(self) -> bool:  # type: ignore[override]
        """True if lamps of the files are the only light."""
        return self.lights == "file"

    def build(self, light: Light, camera: Camera, trajectory: Path) -> Scene:
        """Return the objects of all files, in the light."""
        models: list[list[Piece]] = []
        everything: list[Piece] = []
        notes: list[str] = []
        for placed in self.files:
            used = ["animation"] * placed.animate + ["lights"] * (self.lights == "file")
            pieces, unused = placed.read(*used)
            models.append(pieces)
            notes += unused
            everything += pieces
            check_triangles("the scene", sum(len(piece.faces) for piece in everything))
            check_pictures("the scene", weights_of(piece.paint.material for piece in everything))
        check_names(self.materials, everything)
        materials: dict[str, Material] = {}
        parts: list[tuple[Asset, Placement]] = []
        for index, (placed, pieces) in enumerate(zip(self.files, models, strict=True)):
            path = placed.file.path
            surfacing = Surfacing(path, self.materials, self.reflectance, materials)
            for number, (piece, asset) in enumerate(surfacing.objects(pieces)):
                label, motion = f"file {index} object {number}", piece.motion
                motion = motion and motion.moved(placed.pose)
                kind = printable(quoted(piece.name.strip(), 60)) or "object"
                parts.append((asset, Placement(label, kind, placed.pose, motion)))
        if self.ground is not None:
            materials[_GROUND] = material_of(self.ground)
            ground = Placement(_GROUND, _GROUND, np.eye(4))
            parts.append((_ground_below(parts), ground))
        assets = {placement.asset: asset for asset, placement in parts}
        lit = None if self.is_self_luminous else light.lighting()
        lamps = [lamp for placed in self.files if lit is None for lamp in placed.lamps()]
        if not (lit or lamps or any(material.emission for material in materials.values())):
            raise ValueError(
                "lights 'file': the files have no lamp, and no area light with a radiance as rgb "
                "or spectrum; use 'own'"
            )
        placements = tuple(placement for _, placement in parts)
        return Scene(materials, assets, placements, lit, notes=tuple(notes), lamps=tuple(lamps))

    def describe(self) -> str:
        """Sentence for the report."""
        names = ", ".join(PurePath(placed.file.path).name for placed in self.files)
        has_others = any(placed.file.suffix in (".xml", ".glb", ".gltf") for placed in self.files)
        kept = "; metal, gloss and glass are as the files describe them" if has_others else ""
        return f"Meshes of {names}, with diffuse surfaces{kept}."


def _ground_below(parts: Iterable[tuple[Asset, Placement]]) -> Asset:
    """Return a level square 1e-4 of the objects' extent below them, and 100 times as wide."""
    points = np.concatenate(
        [
            mesh.vertices @ each.to_world[:3, :3].T + each.to_world[:3, 3]
            for asset, each in parts
            for mesh in asset.parts.values()
        ]
    )
    low, high = points.min(axis=0), points.max(axis=0)
    extent = float((high - low).max())
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 50.0 * extent
    corners += [*(low + high)[:2] / 2, low[2] - 1e-4 * extent]
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return Asset({_GROUND: Surface(corners, faces, np.zeros((4, 2))).to_mesh()})
