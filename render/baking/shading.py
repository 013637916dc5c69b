"""Parts that a frame adds to baked light: textures, the sun's disc, and paths.

Moving objects change the light on objects at rest. An object inside a sphere of radius r at a
distance d contributes at most (r/d)² to the irradiance of a point at rest. Where this exceeds 0.01,
paths are traced instead of using baked light.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.render import Bands, RenderSettings, dr, mi
from megalopta.render.baking.cells import Sight
from megalopta.render.baking.gathering import scattered, wavelength_groups
from megalopta.render.baking.visibility import cell_sampler
from megalopta.render.loading.materials import bitmap
from megalopta.render.loading.meshes import MergedMesh, MovingMesh
from megalopta.render.loading.scene import DISC_POINTS
from megalopta.render.path_tracing import LightPaths
from megalopta.scenes.scene import Scene, Sun

# Wavelengths per band mean.
_GRID = 2**10


class Textures:
    """Weights of the second spectrum on all meshes."""

    def __init__(self, scene: Scene, meshes: Sequence[MergedMesh]) -> None:
        textures = [scene.materials[mesh.material].texture for mesh in meshes]
        weights = {id(each.weight): each.weight for each in textures if each}
        place = {key: index for index, key in enumerate(weights)}
        plain = len(weights)
        self._texture = mi.UInt([place[id(each.weight)] if each else plain for each in textures])
        loaded = [mi.load_dict(bitmap(weight)) for weight in weights.values()]
        self._weights = [texture.eval_1 for texture in loaded]
        self._weights.append(lambda _point, _active: mi.Float(0.0))

    def weight(self, sight: Sight) -> Any:
        """Weight (N,) at the points seen by rays."""
        texture = dr.gather(mi.UInt, self._texture, sight.mesh, sight.shaded)
        return dr.switch(texture, self._weights, sight.point, sight.shaded)


class SunLight:
    """Direct light from the disc of sun or moon, also through a surface."""

    def __init__(
        self, scene: Scene, meshes: Sequence[MergedMesh], sun: Sun, bands_nm: Bands
    ) -> None:
        self._bands = len(bands_nm)
        self._center = mi.Vector3f(*sun.direction)
        dr.make_opaque(self._center)
        self._points = mi.Float(sun.points(DISC_POINTS).astype(np.float32).ravel())
        grids = [np.linspace(*band, _GRID) for band in bands_nm]
        table = [
            [np.mean(spectrum(grid) * sun.irradiance(grid)) / np.pi for grid in grids]
            for mesh in meshes
            for spectrum in scattered(scene.materials[mesh.material])
        ]
        self._transmits = mi.Bool([scene.materials[mesh.material].transmits for mesh in meshes])
        self._facing = mi.Float(np.ravel(table).astype(np.float32))

    def radiance(self, loaded: Any, sight: Sight, weight: Any, disc: Any) -> list[Any]:
        """Radiance of each band from the points seen by rays toward the rays' origins.

        `disc` (N,), 0 to 1, selects the point of the disc for the visibility test. The disc is so
        small that its center gives the angle for all of it.
        """
        cosine = dr.dot(sight.point.sh_frame.n, self._center)
        through = (cosine > 0) != sight.front
        place = dr.minimum(mi.UInt(disc * DISC_POINTS), DISC_POINTS - 1)
        toward = dr.gather(mi.Vector3f, self._points, place)
        lit = sight.shaded & (cosine != 0)
        lit &= ~through | dr.gather(mi.Bool, self._transmits, sight.mesh, lit)
        lit &= ~loaded.ray_test(sight.point.spawn_ray(toward), lit)
        cosine = dr.select(lit, dr.abs(cosine), 0.0)
        side = 2 * sight.mesh + dr.select(through, mi.UInt(1), mi.UInt(0))
        row = side * (2 * self._bands)
        first, second = (
            [dr.gather(mi.Float, self._facing, row + k + band, lit) for band in range(self._bands)]
            for k in (0, self._bands)
        )
        return [cosine * dr.lerp(a, b, weight) for a, b in zip(first, second, strict=True)]


class Paths:
    """Mitsuba's path tracer, for selected rays."""

    def __init__(self, settings: RenderSettings) -> None:
        self._bands = settings.bands_nm
        self._paths = LightPaths(settings.max_depth)

    def radiance(self, scene: Any, ray: Any, place: Any, sampler: Any, active: Any) -> list[Any]:
        """Radiance of each band along those of N rays that are active; 0 along others.

        `place` is the position of the wavelength in its band. Active rays are traced separately,
        with random numbers derived from one of the sampler's.
        """
        key = mi.UInt(sampler.next_1d() * 2.0**32)
        found = [dr.zeros(mi.Float, dr.width(active)) for _ in self._bands]
        lanes: Any = dr.compress(active)
        if not dr.width(lanes):
            return found
        rays, place = dr.gather(mi.Ray3f, mi.Ray3f(ray), lanes), dr.gather(mi.Float, place, lanes)
        numbers = cell_sampler()
        numbers.start(dr.gather(mi.UInt, key, lanes), lanes)
        for first, size, wavelengths in wavelength_groups(self._bands, place):
            rays.wavelengths = wavelengths
            values, _ = self._paths.radiance(scene, numbers, rays)
            for band in range(size):
                dr.scatter(found[first + band], values[band], lanes)
        return found


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
