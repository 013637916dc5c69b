"""Boxes and balls that a configuration adds to a scene, at rest or moving."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.spatial.transform import Rotation

from megalopta.assets_gen import generator
from megalopta.assets_gen.bodies import ball, box, checkerboard
from megalopta.assets_gen.tileable_noise import tileable_noise, to_weight
from megalopta.core.record import Record
from megalopta.scenes.kinds import kind_unless_told
from megalopta.scenes.material import Material, Texture
from megalopta.scenes.motion import Drift, ObjectMotion, RigidMotion
from megalopta.scenes.scene import Asset, Placement, Scene
from megalopta.scenes.spectra.spectrum import flat

Vector = tuple[float, float, float]
Length = Annotated[float, Field(gt=0)]
Reflectance = Annotated[float, Field(ge=0, le=1)]


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

    reflectances: tuple[Reflectance, Reflectance] = (0.1, 0.7)
    """Reflectance of the pattern's dark and bright parts, the same at every wavelength (1)."""

    motion: Annotated[ObjectMotion, kind_unless_told("steady")] = Drift()
    """Motion, from position and orientation at the first frame."""

    @property
    def is_at_rest(self) -> bool:
        """True if it neither moves nor spins."""
        return self.motion == Drift(spin_axis=self.motion.spin_axis)


def with_objects(scene: Scene, objects: Sequence[MovingObject]) -> Scene:
    """Add objects to a scene, after the existing ones, each with its own material."""
    materials, assets = dict(scene.materials), dict(scene.assets)
    placements = list(scene.placements)
    for index, thing in enumerate(objects):
        name = f"object {index} {thing.name}"
        materials[name] = _material(thing, index)
        body = (box if thing.shape == "box" else ball)(thing.size_m, thing.tile_m)
        assets[name] = Asset({name: body.to_mesh()})
        to_world = np.eye(4)
        to_world[:3, :3] = Rotation.from_euler("xyz", thing.turn_deg, degrees=True).as_matrix()
        to_world[:3, 3] = thing.position_m
        motion = None if thing.is_at_rest else RigidMotion(thing.position_m, thing.motion)
        placements.append(Placement(name, thing.name, to_world, motion))
    return replace(scene, materials=materials, assets=assets, placements=tuple(placements))


def _material(thing: MovingObject, index: int) -> Material:
    dark, bright = map(flat, thing.reflectances)
    if thing.pattern == "plain":
        return Material(bright)
    return Material(dark, Texture(_pattern(thing.pattern, index), bright))


def _pattern(pattern: str, index: int) -> NDArray[np.float32]:
    if pattern == "checker":
        return checkerboard().astype(np.float32)
    rng = generator(index, "object")
    return to_weight(2 * tileable_noise((128, 128), (1.0, 1.0), (0.05, 0.5), 1.0, rng))
