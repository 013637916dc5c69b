"""Frames of many poses of small things that move, in a large scene at rest."""

from collections.abc import Sequence
from typing import Any

from megalopta.render.light_paths import LightPaths
from megalopta.render.loading.meshes import MergedMesh, MovingMesh
from megalopta.render.loading.scene import load_again, move_meshes
from megalopta.render.mitsuba_loader import dr, mi
from megalopta.render.path_tracing import PathIntegrator
from megalopta.scenes.scene import Scene

_LARGEST_SHARE = 0.5
"""Of the triangles, that move: beyond, two scenes are not worth the second look of each ray."""


def is_layered(scene: Scene, meshes: Sequence[MergedMesh]) -> bool:
    """Whether what moves in clear air is small, does not glow and has something at rest by it."""
    moving = [mesh for mesh in meshes if isinstance(mesh, MovingMesh)]
    triangles = sum(len(mesh.faces) for mesh in moving)
    return (
        0 < triangles <= _LARGEST_SHARE * sum(len(mesh.faces) for mesh in meshes)
        and not any(scene.materials[mesh.material].emission for mesh in moving)
        and not scene.haze
        and not str(mi.variant()).startswith("scalar")
    )


class Layers(PathIntegrator):
    """Traces paths through a scene at rest and through one of what moves, in its own copy.

    What moves has the surfaces of the loaded scene, which lights both.
    """

    def __init__(
        self, max_depth: int, meshes: Sequence[MergedMesh], loaded: Any, still: Any
    ) -> None:
        super().__init__(max_depth)
        self._meshes = [mesh for mesh in meshes if isinstance(mesh, MovingMesh)]
        shapes = loaded.shapes()[len(meshes) - len(self._meshes) :]
        self._layers = still, load_again(self._meshes, shapes)
        self._trace = LightPaths(max_depth, *self._layers)

    def move_to(self, time_s: float) -> None:
        """Put moving objects where they are at a time."""
        normals = {n: mesh.normals_at(time_s) for n, mesh in enumerate(self._meshes)}
        vertices = {n: mesh.vertices_at(time_s) for n, mesh in enumerate(self._meshes)}
        turned = {n: each for n, each in normals.items() if each is not None}
        move_meshes(self._layers[1], vertices, turned)

    def _sky(self, scene: Any, ray: Any) -> Any:
        free = [~layer.ray_test(ray) for layer in self._layers]
        return dr.select(free[0] & free[1], 1.0, 0.0)
