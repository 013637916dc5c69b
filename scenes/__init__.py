"""What stands where, what lights it and how the camera moves, as plain frozen data.

    light, camera, trajectory = Light(level="starlight"), PerspectiveCamera(), Trajectory()
    scene = build_scene(Forest(trees=200), light, camera, trajectory)

World coordinates are right-handed meters with z up. Nothing here knows a renderer.
"""

from megalopta.scenes.build import build_scene
from megalopta.scenes.camera import PerspectiveCamera
from megalopta.scenes.forest import Forest
from megalopta.scenes.grating import Grating
from megalopta.scenes.light import Light
from megalopta.scenes.panorama import Panorama
from megalopta.scenes.scene import Scene
from megalopta.scenes.trajectory import Trajectory

__all__ = [
    "Forest",
    "Grating",
    "Light",
    "Panorama",
    "PerspectiveCamera",
    "Scene",
    "Trajectory",
    "build_scene",
]
