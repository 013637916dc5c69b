"""Frames from light that was computed once: primary rays alone, and a look at the sun.

Every sample of a pixel looks up what its surface sends out (`bake`), weighs the two reflectances by
the surface's texture, and, where there is a sun or moon, sends one more ray there: shadow edges are
as sharp as those of the path tracer. What glows, sky included, is seen as it is. Cells that no
frame has seen before are computed when they are first seen, so only what the camera sees is baked.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render import Bands, RenderSettings, dr, mi
from megalopta.render.baking.cells import CellFinder, Cells, Sight
from megalopta.render.baking.light import BakedLight, reflectances, wavelength_groups
from megalopta.render.baking.visibility import survey
from megalopta.render.loading import DISC_POINTS, MergedMesh, bitmap
from megalopta.scenes.cameras import Camera
from megalopta.scenes.world import Scene, Sun

# Samples traced at once: what they saw is kept until all cells they saw are baked.
SAMPLES_AT_ONCE = 2**22
# Samples per pixel in a whole sequence from which on baking pays, in units of `bake_samples`. A
# frame sees fewer cells than it has samples, and few cells take all of `bake_samples`.
_PAYS_FROM = 8
# Wavelengths of a band's mean.
_GRID = 2**10


def path_tracing_reason(
    scene: Scene, variant: str, poses: NDArray[np.float64] | None, settings: RenderSettings
) -> str:
    """Why frames are rendered by path tracing; empty where their light is baked.

    Poses (T, 4, 4) are those of the sequence, where it is known.
    """
    if settings.integrator == "path":
        return "as asked"
    if variant.startswith("scalar"):
        return "baking needs a vectorized variant"
    if not scene.placements:
        return "there is no surface to bake light on"
    if scene.is_moving:
        return "objects move, and with them light and shadow on all others"
    if poses is None:
        return "the camera's path is not known"
    samples = len(poses) * settings.samples_per_pixel
    if settings.integrator == "auto" and samples < _PAYS_FROM * settings.bake_samples:
        return f"{samples} samples per pixel in all frames are too few to pay for baking"
    return ""


class BakedLightIntegrator:
    """A scene whose light is baked as cameras see it.

    The poses (T, 4, 4) of the sequence are relative to the scene's origin: where it comes close
    surfaces are cut finely, and what it sees much of gets the most paths. The seed has 32 bits.
    """

    def __init__(
        self,
        loaded: Any,
        scene: Scene,
        meshes: Sequence[MergedMesh],
        settings: RenderSettings,
        camera: Camera,
        poses: NDArray[np.float64],
        seed: int,
    ) -> None:
        self._bands = settings.bands_nm
        cells = Cells.of(meshes, camera, poses[:, :3, 3])
        self._finder = CellFinder(cells, loaded)
        seen = survey(loaded, self._finder, cells.count, camera, poses, seed)
        self._light = BakedLight(loaded, scene, meshes, cells, seen, settings, seed)
        self._textures = _Textures(scene, meshes)
        sun = scene.lighting.sun if scene.lighting and settings.max_depth > 1 else None
        self._sun = _Sun(scene, meshes, sun, self._bands) if sun else None

    def render(self, scene: Any, sensor: Any, seed: int, spp: int) -> NDArray[np.float32]:
        """Radiance (H, W, B) that a sensor sees, band means, W·m⁻²·sr⁻¹·nm⁻¹; as Mitsuba's own."""
        width, height = sensor.film().crop_size()
        pixels, samples = int(width * height), spp
        at_once = _largest_divisor(samples, max(1, SAMPLES_AT_ONCE // pixels))
        sampler = sensor.sampler()
        sampler.set_samples_per_wavefront(at_once)
        sampler.seed(seed, pixels * at_once)
        total = [dr.zeros(mi.Float, pixels) for _ in self._bands]
        for first in range(0, samples, at_once):
            lane = dr.arange(mi.UInt, pixels * at_once)
            pixel = lane // at_once
            corner = mi.Point2f(pixel % width, pixel // width)
            place = (mi.Float(lane - pixel * at_once + first) + 0.5) / samples
            position = (corner + sampler.next_2d()) / mi.Point2f(width, height)
            ray, _ = sensor.sample_ray(0.0, 0.5, position, mi.Point2f(0.5))
            disc = sampler.next_1d() if self._sun else mi.Float(0.0)
            seen = self._seen(scene, ray, place, disc)
            for band, values in enumerate(seen):
                total[band] += dr.block_sum(values, at_once) / samples
            sampler.advance()
            sampler.schedule_state()
            dr.eval(total)
        return np.stack([np.array(values) for values in total], axis=-1).reshape(
            height, width, len(self._bands)
        )

    def _seen(self, scene: Any, ray: Any, place: Any, disc: Any) -> list[Any]:
        """Radiance of each band along rays.

        `place` is that of the wavelength in its band, `disc` a number from 0 to 1 that chooses the
        point of the sun's disc.
        """
        sight = self._finder.look(scene, ray)
        weight = self._textures.weight(sight)
        seen = self._emitted(scene, sight.point, place)
        if self._sun:
            direct = self._sun.radiance(scene, sight, weight, disc)
            seen = [a + b for a, b in zip(seen, direct, strict=True)]
        dr.eval(sight.cell, sight.shaded, weight, seen)
        self._light.bake_missing(sight.cell, sight.shaded)
        baked = self._light.radiance(sight.cell, weight, sight.shaded)
        return [a + b for a, b in zip(seen, baked, strict=True)]

    def _emitted(self, scene: Any, point: Any, place: Any) -> list[Any]:
        """What sky and glowing surfaces send out themselves."""
        emitter = point.emitter(scene)
        emitted = []
        for _, size, wavelengths in wavelength_groups(self._bands, place):
            point.wavelengths = wavelengths
            values = emitter.eval(point)
            emitted += [values[band] for band in range(size)]
        return emitted


class _Textures:
    """Weights of the second reflectance on all meshes."""

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


class _Sun:
    """Light that comes straight from the disc of sun or moon."""

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
            for spectrum in reflectances(scene.materials[mesh.material])
        ]
        self._facing = mi.Float(np.ravel(table).astype(np.float32))

    def radiance(self, loaded: Any, sight: Sight, weight: Any, disc: Any) -> list[Any]:
        """Radiance of each band that leaves the points that rays see toward their origins.

        `disc` (N,), 0 to 1, chooses the point of the disc that has to be in view. The disc is so
        small that its center stands for the angle of all of it.
        """
        cosine = dr.dot(sight.point.sh_frame.n, self._center)
        cosine = dr.select(sight.front, cosine, -cosine)
        place = dr.minimum(mi.UInt(disc * DISC_POINTS), DISC_POINTS - 1)
        toward = dr.gather(mi.Vector3f, self._points, place)
        lit = sight.shaded & (cosine > 0)
        lit &= ~loaded.ray_test(sight.point.spawn_ray(toward), lit)
        cosine = dr.select(lit, cosine, 0.0)
        row = sight.mesh * (2 * self._bands)
        first, second = (
            [dr.gather(mi.Float, self._facing, row + k + band, lit) for band in range(self._bands)]
            for k in (0, self._bands)
        )
        return [cosine * dr.lerp(a, b, weight) for a, b in zip(first, second, strict=True)]


def _largest_divisor(number: int, limit: int) -> int:
    return max(each for each in range(1, min(number, limit) + 1) if number % each == 0)
