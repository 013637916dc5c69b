"""What a frame adds to baked light: textures, and light straight from sun or moon."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from megalopta.render import Bands, dr, mi
from megalopta.render.baking.cells import Sight
from megalopta.render.baking.scattering import scattered
from megalopta.render.loading.materials import bitmap
from megalopta.render.loading.meshes import MergedMesh
from megalopta.render.loading.scene import DISC_POINTS
from megalopta.scenes.scene import Scene, Sun

# Wavelengths of a band's mean.
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
        """Weight (N,) at the points that rays see."""
        texture = dr.gather(mi.UInt, self._texture, sight.mesh, sight.shaded)
        return dr.switch(texture, self._weights, sight.point, sight.shaded)


class SunLight:
    """Light that comes straight from the disc of sun or moon, also through a surface."""

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
        """Radiance of each band that leaves the points that rays see toward their origins.

        `disc` (N,), 0 to 1, chooses the point of the disc that has to be in view. The disc is so
        small that its center stands for the angle of all of it.
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
