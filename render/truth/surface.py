"""What rays see: points on triangles, and which of a triangle's two sides."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from megalopta.core.compiling import compiled
from megalopta.render.truth.views import Times, of_rays

Float64 = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Surface:
    """What N rays see."""

    triangle: Integers
    """(N,): row of the triangle in the geometry's tables; -1 for the sky."""
    points: Float64
    """(N, 3): place on the surface, m; for the sky the ray's direction."""
    directions: Float64
    """(N, 3): of the rays."""
    barycentric: Float64
    """(N, 2): weights of the triangle's second and third vertex, where objects move."""
    distance: Float64
    """(N,): along the ray, m; infinite for the sky."""
    time_s: Times
    """When it is seen."""

    @property
    def is_sky(self) -> NDArray[np.bool_]:
        """Where nothing was hit (N,)."""
        return self.triangle < 0

    def of(self, ray: NDArray[np.bool_]) -> "Surface":
        """What some of the rays see."""
        return Surface(
            self.triangle[ray],
            self.points[ray],
            self.directions[ray],
            self.barycentric[ray],
            self.distance[ray],
            of_rays(self.time_s, ray),
        )


@compiled
def same_side(triangle, at_rest, faces, vertices, seen, way):  # type: ignore[no-untyped-def]
    """Whether two directions each (N, 3) meet the same side of triangles at rest, or the sky."""
    found = np.ones(len(triangle), np.bool_)
    u, v = np.empty(3), np.empty(3)
    for ray in range(len(triangle)):
        if not 0 <= triangle[ray] < at_rest:
            continue
        a, b, c = faces[triangle[ray]]
        for axis in range(3):
            start = np.float64(vertices[a, axis])
            u[axis], v[axis] = vertices[b, axis] - start, vertices[c, axis] - start
        x = u[1] * v[2] - u[2] * v[1]
        y = u[2] * v[0] - u[0] * v[2]
        z = u[0] * v[1] - u[1] * v[0]
        once = x * seen[ray, 0] + y * seen[ray, 1] + z * seen[ray, 2]
        found[ray] = once * (x * way[ray, 0] + y * way[ray, 1] + z * way[ray, 2]) > 0
    return found
