"""Scene description to scene: shapes planted or drawn, light added."""

from dataclasses import replace
from typing import Annotated

from pydantic import Field

from megalopta.scenes.camera import PerspectiveCamera
from megalopta.scenes.forest import Forest, build_forest
from megalopta.scenes.grating import Grating, build_grating
from megalopta.scenes.light import Light
from megalopta.scenes.panorama import Panorama, build_panorama
from megalopta.scenes.scene import Scene
from megalopta.scenes.trajectory import Trajectory

SceneDescription = Annotated[Forest | Grating | Panorama, Field(discriminator="kind")]
"""Any scene that can be described in a configuration; `kind` tells which."""


def build_scene(
    description: SceneDescription, light: Light, camera: PerspectiveCamera, trajectory: Trajectory
) -> Scene:
    """Build what a camera on a trajectory will see.

    A forest keeps its trunks clear of the camera's path; a grating surrounds the camera, which
    may only turn, and glows as brightly as a sky of the light's illuminance.
    """
    if isinstance(description, Panorama):
        return build_panorama(description, light.resolved())
    if isinstance(description, Grating):
        lux = light.resolved().illuminance_lux
        return build_grating(description, camera, trajectory, lux)
    path = trajectory.poses()[:, :2, 3]
    return replace(build_forest(description, path), lighting=light.lighting())
