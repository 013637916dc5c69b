"""Scenes, cameras and paths of a configuration, and a scene from its description."""

from collections.abc import Sequence
from dataclasses import replace
from inspect import isabstract
from typing import TYPE_CHECKING, NamedTuple, get_args

from megalopta.core.plug_ins import plug_ins
from megalopta.scenes.base import SceneDescription, any_of, kind_of
from megalopta.scenes.cameras.base import Camera
from megalopta.scenes.cameras.opencv import OpenCVCamera
from megalopta.scenes.cameras.panoramic import CylindricalCamera, EquirectangularCamera
from megalopta.scenes.cameras.perspective import PerspectiveCamera
from megalopta.scenes.forest.description import Forest
from megalopta.scenes.light import Light
from megalopta.scenes.meshes.description import Meshes
from megalopta.scenes.moving_objects import AnyObject, with_objects
from megalopta.scenes.scene import Scene
from megalopta.scenes.stimuli.grating import Grating
from megalopta.scenes.stimuli.panorama import Panorama
from megalopta.scenes.stimuli.pictures import Pictures
from megalopta.scenes.stimuli.plane import MotionBench, Plane
from megalopta.scenes.trajectories.base import Path
from megalopta.scenes.trajectories.orbit import Fit, Orbit
from megalopta.scenes.trajectories.recorded import Recorded
from megalopta.scenes.trajectories.steady import Hover, Trajectory

OWN_CAMERAS = (OpenCVCamera, EquirectangularCamera, CylindricalCamera, PerspectiveCamera)

if TYPE_CHECKING:
    AnyCamera = Camera
else:
    AnyCamera = any_of(OWN_CAMERAS, "perspective")
    """Any camera in a configuration, by `kind`; without one, perspective."""


if TYPE_CHECKING:
    CameraPath = Path
else:
    CameraPath = any_of((Orbit, Fit, Recorded, Trajectory, Hover), "steady")
    """Any camera path in a configuration, by `kind`; without one, steady."""


OWN_SCENES = (Forest, Grating, Plane, MotionBench, Meshes, Panorama, Pictures)


class _Offered(NamedTuple):
    name: str
    model: type[SceneDescription]


def _offered(value: object) -> _Offered:
    if not (isinstance(value, type) and issubclass(value, SceneDescription)):
        raise ValueError(f"{value!r} does not derive from megalopta.scenes.SceneDescription")
    kind = kind_of(value)
    if isabstract(value) or get_args(value.model_fields["kind"].annotation) != (kind,):
        raise ValueError(
            f'{value.__name__} needs the methods build and describe, and kind: Literal["…"] = "…"'
        )
    return _Offered(kind, value)


if TYPE_CHECKING:
    AnyScene = SceneDescription
else:
    _others = plug_ins("megalopta.scenes", _offered, [*map(kind_of, OWN_SCENES)])
    AnyScene = any_of([*OWN_SCENES, *(plug_in.model for plug_in in _others.values())])
    """Any scene in a configuration, by `kind`."""


def build_scene(
    description: SceneDescription,
    light: Light,
    camera: Camera,
    trajectory: Path,
    objects: Sequence[AnyObject] = (),
) -> Scene:
    """Build the scene that a camera on a trajectory sees, including the user's own objects.

    It is the same for all cameras of a rig.
    """
    scene = description.build(light, camera, trajectory.mounted(None))
    return with_objects(replace(scene, origin_m=trajectory.origin_m), objects)
