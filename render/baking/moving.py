"""Where moving objects change the light on what is at rest, so that baked light will not do.

An object inside a sphere of radius r around a center at a distance d takes up at most (r/d)² of the
irradiance of a point at rest. Nearer than where that is a hundredth, paths are traced.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render import dr, mi
from megalopta.render.loading.meshes import MergedMesh, MovingMesh

MOST_OBJECTS = 16
"""Of which each point looks for the nearest."""
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
        """Take the objects to where they are at a time."""
        self._spheres = []
        for mesh in self._meshes:
            vertices = mesh.vertices_at(time_s)
            for part in mesh.parts:
                center, reach = _sphere(vertices[part.vertices])
                sphere = mi.Point3f(center.tolist()), mi.Float(reach**2 / _LARGEST_SHARE)
                dr.make_opaque(sphere)  # or every time would be compiled anew
                self._spheres.append(sphere)

    def holds(self, points: Any) -> Any:
        """Which points (N,) are near."""
        near = mi.Bool(False)
        for center, reach2 in self._spheres:
            near |= dr.squared_norm(points - center) < reach2
        return near


def _sphere(vertices: NDArray[np.float32]) -> tuple[NDArray[np.float64], float]:
    """Center (3,) and radius of a sphere around points (n, 3)."""
    center = (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0
    return center, float(np.linalg.norm(vertices - center, axis=1).max())
