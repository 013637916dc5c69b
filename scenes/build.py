"""Scene description to scene: shapes planted or drawn, light added."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated

from pydantic import Field

from megalopta.scenes.cameras import Camera
from megalopta.scenes.forest import Forest, build_forest
from megalopta.scenes.lighting import Light
from megalopta.scenes.moving_objects import MovingObject, with_objects
from megalopta.scenes.stimuli import (
    Bench,
    Grating,
    Panorama,
    Plane,
    build_bench,
    build_grating,
    build_panorama,
    build_plane,
)
from megalopta.scenes.trajectories import CameraPath, Trajectory
from megalopta.scenes.world import Scene

SceneDescription = Annotated[
    Forest | Grating | Plane | Bench | Panorama, Field(discriminator="kind")
]
"""Any scene that can be described in a configuration; `kind` tells which."""


def build_scene(
    description: SceneDescription,
    light: Light,
    camera: Camera,
    trajectory: CameraPath,
    objects: Sequence[MovingObject] = (),
) -> Scene:
    """Build what a camera on a trajectory will see, with objects of the user's own.

    A forest keeps its trunks clear of the camera's path. Gratings and the bench glow by themselves,
    as brightly as a sky of the light's illuminance.
    """
    scene = _surroundings(description, light, camera, trajectory)
    return with_objects(replace(scene, origin_m=trajectory.origin_m), objects)


def _surroundings(
    description: SceneDescription, light: Light, camera: Camera, trajectory: CameraPath
) -> Scene:
    if isinstance(description, Panorama):
        return build_panorama(description, light.resolved())
    lux = light.resolved().illuminance_lux
    if isinstance(description, Grating):
        if not isinstance(trajectory, Trajectory):
            raise ValueError(
                f"trajectory.kind {trajectory.kind!r}: a grating surrounds a camera that turns in "
                "place; use 'steady'"
            )
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
