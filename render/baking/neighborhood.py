"""Points near moving objects, where paths are traced in place of baked light.

Moving objects change the light on objects at rest. An object inside a sphere of radius r at a
distance d contributes at most (r/d)² to the irradiance of a point at rest. Where this exceeds 0.01,
paths are traced instead of using baked light.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.render import dr, mi
from megalopta.render.loading.meshes import MergedMesh, MovingMesh

MOST_OBJECTS = 16
"""Number of objects among which each point searches the nearest."""
_LARGEST_SHARE = 0.01


class Neighborhood:
    """Points near moving objects."""

    def __init__(self, meshes: Sequence[MergedMesh]) -> None:
        self._meshes = [mesh for mesh in meshes if isinstance(mesh, MovingMesh)]
        self._spheres: list[tuple[Any, Any]] = []
        self.move_to(0.0)

    def __bool__(self) -> bool:
        return bool(self._meshes)

    def move_to(self, time_s: float) -> None:
        """Move the objects to a time."""
        self._spheres = []
        for mesh in self._meshes:
            vertices = mesh.vertices_at(time_s)
            for part in mesh.parts:
                center, reach = _sphere(vertices[part.vertices])
                sphere = mi.Point3f(center.tolist()), mi.Float(reach**2 / _LARGEST_SHARE)
                dr.make_opaque(sphere)  # otherwise every time would be compiled anew
                self._spheres.append(sphere)

    def holds(self, points: Any) -> Any:
        """True for points (N,) near moving objects."""
        near = mi.Bool(False)
        for center, reach2 in self._spheres:
            near |= dr.squared_norm(points - center) < reach2
        return near


def _sphere(vertices: NDArray[np.float32]) -> tuple[Floats, float]:
    """Center (3,) and radius of a sphere around points (n, 3)."""
    center = (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0
    return center, float(np.linalg.norm(vertices - center, axis=1).max())
