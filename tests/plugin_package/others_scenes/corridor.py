"""Two gray walls to the left and right of the camera."""

from typing import Annotated, Literal

import numpy as np
import trimesh
from pydantic import Field

from megalopta.scenes import Camera, Light, SceneDescription
from megalopta.scenes.material import Material
from megalopta.scenes.scene import Asset, Placement, Scene
from megalopta.scenes.spectra.spectrum import flat
from megalopta.scenes.trajectories.base import Path


class Corridor(SceneDescription, frozen=True):
    """A corridor without ceiling around the camera's first position."""

    kind: Literal["corridor"] = "corridor"
    """Kind of scene."""

    width_m: Annotated[float, Field(gt=0.5)] = 3.0
    """Distance between the walls (m)."""

    reflectance: Annotated[float, Field(ge=0, le=1)] = 0.4
    """Of the walls (1)."""

    @property
    def counts(self):
        return {"walls": 2}

    def build(self, light: Light, camera: Camera, trajectory: Path) -> Scene:
        wall = Asset({"wall": trimesh.creation.box((60.0, 0.2, 3.0))})
        poses = np.tile(np.eye(4), (2, 1, 1))
        poses[:, :3, 3] = trajectory.poses()[0, :3, 3]
        poses[:, 1, 3] += self.width_m / 2 * np.array([1, -1])
        placements = tuple(Placement("wall", "wall", pose) for pose in poses)
        materials = {"wall": Material(flat(self.reflectance))}
        return Scene(materials, {"wall": wall}, placements, light.lighting())

    def describe(self) -> str:
        return f"A corridor, {self.width_m:g} m wide."
