"""Scene, light, camera and its path: the part that every stage depends on."""

import re
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from megalopta.core.bounded import quoted
from megalopta.core.record import Record
from megalopta.flow.benchmark import each_once
from megalopta.scenes import AnyObject, AnyScene
from megalopta.scenes.build import AnyCamera, CameraPath
from megalopta.scenes.cameras.perspective import PerspectiveCamera
from megalopta.scenes.forest.description import Forest
from megalopta.scenes.light import Light
from megalopta.scenes.trajectories.base import Mount
from megalopta.scenes.trajectories.steady import Trajectory

ONCE = AfterValidator(each_once)
"""Refuses duplicates among the values of a field"""
# File names hold sensor, repeat, level, product, and a prefix during writing; file systems allow
# 255 bytes.
_LONGEST_NAME = 100


def own_fields(part: type[Record]) -> tuple[str, ...]:
    """Return the fields that a part of the configuration adds to those of the parts before it."""
    return tuple(part.__annotations__)


def folder_name(name: str) -> str:
    """Return a name of folders and files. Raises ValueError for any other."""
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]*", name):
        raise ValueError(f"{name!r} cannot name a folder: use letters, digits, - and _")
    if len(name) > _LONGEST_NAME:
        raise ValueError(f"{quoted(name, 40)!r}: use a name of at most {_LONGEST_NAME} characters")
    return name


class SceneSettings(Record, frozen=True):
    """Scene, light, camera and its path."""

    name: Annotated[str, AfterValidator(folder_name)] = "forest"
    """Name of the sequence and its folders: letters, digits, dash and underscore."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Seed of rendering noise and photon arrivals."""
    scene: AnyScene = Forest()
    """Scene to render."""
    objects: tuple[AnyObject, ...] = ()
    """Boxes, balls and mesh files (`file`) added to the scene, at rest or on paths of their own."""
    light: Light = Light()
    """Light that the scene is rendered under."""
    camera: AnyCamera = PerspectiveCamera()
    """Projection, image size and field of view."""
    scene_camera: AnyCamera | None = Field(default=None, exclude_if=lambda camera: camera is None)
    """Camera that the scene's detail and extent suit, on a rig of different cameras; default: this
    one."""
    trajectory: CameraPath = Trajectory()
    """Camera motion."""
    stereo_with: Mount | None = Field(default=None, exclude_if=lambda mount: mount is None)
    """Second camera of the rig on the path, side by side with this one: `training/disparities`
    holds the disparity to it. By default there is none."""

    @model_validator(mode="after")
    def _light_and_cameras_suit(self) -> "SceneSettings":
        needs_sky = self.light.panorama is not None or self.light.sky != "even"
        if needs_sky and not self.scene.is_lit_from_outside:
            raise ValueError(
                f"light.{'panorama' if self.light.panorama else 'sky'}: a scene of kind "
                f"{self.scene.kind!r} has its own light; omit it, or use a forest"
            )
        if self.camera.lens_m and not self.scene.has_surfaces:
            raise ValueError(
                f"camera.aperture_mm: a scene of kind {self.scene.kind!r} has no surfaces that a "
                "lens could blur; omit it and focus_m"
            )
        if self.stereo_with and self.camera.intrinsics is None:
            raise ValueError(
                f"stereo_with: the {self.camera} has no lines along which to shift points; use a "
                "pinhole, or omit it"
            )
        if self.stereo_with and self.baseline_m is None:
            raise ValueError(
                "stereo_with: the two cameras do not look the same way side by side; change "
                "position_m along x only, or omit it"
            )
        return self

    @property
    def baseline_m(self) -> float | None:
        """Distance to the camera `stereo_with`, m, positive to the right; None without one."""
        mount = self.trajectory.mount or Mount()
        return mount.baseline_m(self.stereo_with) if self.stereo_with else None
