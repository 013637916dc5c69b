"""Boxes, balls and meshes that a configuration adds to a scene, at rest or moving."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import PurePath
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag

from megalopta.assets_gen import generator
from megalopta.assets_gen.bodies import ball, box
from megalopta.assets_gen.tileable_noise import tileable_noise, to_weight
from megalopta.core.record import Record
from megalopta.scenes.material import Material, Texture
from megalopta.scenes.meshes.model import PlacedMesh, pose_of
from megalopta.scenes.meshes.pieces import check_pictures, weights_of
from megalopta.scenes.meshes.reflectance import Reflectance, Share
from megalopta.scenes.meshes.surfaces import Surfacing, check_names
from megalopta.scenes.motion import Drift, RigidMotion, Vector
from megalopta.scenes.scene import Asset, Lighting, Placement, Scene
from megalopta.scenes.spectra.spectrum import flat

Length = Annotated[float, Field(gt=0)]


class MovingObject(Record, frozen=True):
    """Textured box or ball."""

    name: str = "box"
    """Name of the object; ground truth lists it as the object's kind."""
    shape: Literal["box", "ball"] = "box"
    """Shape of the object."""
    size_m: tuple[Length, Length, Length] = (0.5, 0.5, 0.5)
    """Extent along its own axes (x, y, z in m)."""
    position_m: Vector = (5.0, 0.0, 1.5)
    """Center at the first frame (x, y, z in m; z is up)."""
    turn_deg: Vector = (0.0, 0.0, 0.0)
    """Orientation at the first frame: turns about the world's x, then y, then z (degrees)."""
    pattern: Literal["checker", "noise", "plain"] = "noise"
    """Painted pattern."""
    tile_m: Length = 0.25
    """Size of the repeating square of the pattern (m)."""
    reflectances: tuple[Share, Share] = (0.1, 0.7)
    """Reflectance of the pattern's dark and bright parts, the same at every wavelength (1)."""
    motion: Drift = Drift()
    """Motion, from position and orientation at the first frame."""


class MovingModel(PlacedMesh, frozen=True):
    """Mesh file as one object, at its place at the first frame; it spins about its origin."""

    name: str | None = None
    """Name of the object; ground truth lists it as the object's kind; null: that of the file."""
    materials: dict[str, Reflectance] = Field(
        default={},
        description="Reflectances in place of colors, by the name of a material, as in a scene of "
        "meshes.",
    )
    motion: Drift = Drift()
    """Motion, from position and orientation at the first frame."""


def _class_of(fields: Any) -> str:
    is_file = "file" in fields if isinstance(fields, Mapping) else isinstance(fields, MovingModel)
    return (MovingModel if is_file else MovingObject).__name__


if TYPE_CHECKING:
    AnyObject = MovingObject | MovingModel
else:
    AnyObject = Annotated[
        Annotated[MovingObject, Tag(MovingObject.__name__)]
        | Annotated[MovingModel, Tag(MovingModel.__name__)],
        Discriminator(_class_of),
    ]
    """Any object that a configuration adds: a mesh if it has a `file`."""


def with_objects(scene: Scene, objects: Sequence[AnyObject]) -> Scene:
    """Add objects to a scene, after the existing ones, each with its own materials.

    A panorama around the camera lights them.
    """
    if scene.environment and objects:
        lighting = Lighting(flat(0.0), panorama=scene.environment)
        scene = replace(scene, environment=None, lighting=lighting)
    materials, assets = dict(scene.materials), dict(scene.assets)
    placements, notes = list(scene.placements), list(scene.notes)
    for index, thing in enumerate(objects):
        if isinstance(thing, MovingModel):
            kind = thing.name or PurePath(thing.file.path).stem
            name = f"object {index} {kind}"
            pieces, unused = thing.read()
            check_names(thing.materials, pieces)
            label = f"{name} {thing.file.path}"
            surfacing = Surfacing(label, thing.materials, materials=materials)
            assets[name] = surfacing.whole(pieces)
            check_pictures(label, weights_of(materials.values()))
            notes += unused
        else:
            kind, name = thing.name, f"object {index} {thing.name}"
            dark, bright = map(flat, thing.reflectances)
            half = np.arange(64) < 32
            weight = (half[:, None] ^ half).astype(np.float32)
            if thing.pattern == "noise":
                noise = generator(index, "object")
                tile = tileable_noise((128, 128), (1.0, 1.0), (0.05, 0.5), 1.0, noise)
                weight = to_weight(2 * tile)
            painted = Material(dark, Texture(weight, bright))
            materials[name] = Material(bright) if thing.pattern == "plain" else painted
            body = (box if thing.shape == "box" else ball)(thing.size_m, thing.tile_m)
            assets[name] = Asset({name: body.to_mesh()})
        is_at_rest = thing.motion == Drift(spin_axis=thing.motion.spin_axis)
        motion = None if is_at_rest else RigidMotion(thing.position_m, thing.motion)
        to_world = pose_of(thing.position_m, thing.turn_deg)
        placements.append(Placement(name, kind, to_world, motion))
    return replace(
        scene, materials=materials, assets=assets, placements=tuple(placements), notes=tuple(notes)
    )
