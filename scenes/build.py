"""Scene description to scene: shapes planted or drawn, light added."""

from dataclasses import replace
from typing import Annotated

from pydantic import Field

from megalopta.scenes.bench import Bench, build_bench
from megalopta.scenes.camera import PerspectiveCamera
from megalopta.scenes.forest import Forest, build_forest
from megalopta.scenes.grating import Grating, build_grating
from megalopta.scenes.light import Light
from megalopta.scenes.plane import Plane, build_plane
from megalopta.scenes.scene import Scene
from megalopta.scenes.trajectory import Trajectory

SceneDescription = Annotated[Forest | Grating | Plane | Bench, Field(discriminator="kind")]
"""Any scene that can be described in a configuration; `kind` tells which."""


def build_scene(
    description: SceneDescription, light: Light, camera: PerspectiveCamera, trajectory: Trajectory
) -> Scene:
    """Build what a camera on a trajectory will see.

    A forest keeps its trunks clear of the camera's path. Gratings and the bench glow by themselves,
    as brightly as a sky of the light's illuminance.
    """
    lux = light.resolved().illuminance_lux
    if isinstance(description, Grating):
        return build_grating(description, camera, trajectory, lux)
    if isinstance(description, Plane):
        return build_plane(description, camera, trajectory, lux)
    if isinstance(description, Bench):
        return build_bench(description, camera, trajectory, lux)
    path = trajectory.poses()[:, :2, 3]
    return replace(build_forest(description, path), lighting=light.lighting())


def glows(description: SceneDescription) -> bool:
    """Whether a scene is its own light, of flat spectrum."""
    return isinstance(description, Grating | Plane | Bench)
