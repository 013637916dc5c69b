"""Loaded scenes whose meshes rays meet: one, or one at rest and a small one of moving objects.

Only the small one is rebuilt when objects move.
"""

from collections.abc import Sequence
from typing import Any

from megalopta.render import dr, mi
from megalopta.render.loading.meshes import MergedMesh, MovingMesh
from megalopta.render.loading.scene import load_mesh, move_to, of_shapes

_LARGEST_MOVING_SHARE = 0.5
"""Share of moving triangles above which two scenes do not pay for intersecting each ray twice."""


class Layers:
    """One or two loaded scenes, to be intersected as one."""

    def __init__(self, *scenes: Any) -> None:
        self.scenes = scenes

    def move_to(self, time_s: float) -> None:
        """Do nothing: who loaded the scenes moves their objects."""

    def ray_intersect_preliminary(
        self, rays: Any, coherent: bool = False, active: Any = True
    ) -> Any:
        """Nearest hits of rays."""
        hits = [
            scene.ray_intersect_preliminary(rays, coherent=coherent, active=active)
            for scene in self.scenes
        ]
        nearest = hits[0]
        for other in hits[1:]:
            nearest = dr.select(other.t < nearest.t, other, nearest)
        return nearest

    def ray_test(self, rays: Any, active: Any = True) -> Any:
        """True for rays that hit something."""
        blocked = mi.Bool(False)
        for scene in self.scenes:
            blocked |= scene.ray_test(rays, active)
        return blocked


def is_layered(meshes: Sequence[MergedMesh]) -> bool:
    """True if moving objects are small, and come with objects at rest."""
    moving = sum(len(mesh.faces) for mesh in meshes if isinstance(mesh, MovingMesh))
    return 0 < moving <= _LARGEST_MOVING_SHARE * sum(len(mesh.faces) for mesh in meshes)


class MovingScene(Layers):
    """Scene of the meshes at rest, and a copy of the moving ones with the loaded surfaces."""

    def __init__(self, meshes: Sequence[MergedMesh], loaded: Any, still: Any) -> None:
        self._meshes = [mesh for mesh in meshes if isinstance(mesh, MovingMesh)]
        shapes = loaded.shapes()[len(meshes) - len(self._meshes) :]
        pairs = zip(self._meshes, shapes, strict=True)
        again = [load_mesh(mesh, mesh_bsdf=shape.bsdf()) for mesh, shape in pairs]
        super().__init__(still, of_shapes(again))

    def move_to(self, time_s: float) -> None:
        """Move the moving meshes to a time."""
        move_to(self.scenes[1], dict(enumerate(self._meshes)), time_s)
