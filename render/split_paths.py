"""Path tracing that splits the light of the surfaces seen into parts, each with its own samples.

- Light from the disc of sun or moon takes one more ray, nearly parallel to its neighbors'. In a
  forest it is most of the light and most of the noise.
- Light from the sky takes one ray in a random direction.
- Light from other surfaces takes a path, ten times as dear, and brings a tenth of the light.

The best numbers of samples are in proportion to the root of variance over cost. Those below are
within 10 % of the least cost at equal error in all forests and lights of
`benchmarks/bench_light.py`. All parts are unbiased, and so is their sum.

Bands need no more paths than one for the first two parts: surfaces are diffuse, so light and
reflectance are known for each band as a whole.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render import dr, mi
from megalopta.render.loading.layers import Layers
from megalopta.render.loading.scene import LoadedScene, MeshIndex
from megalopta.render.path_tracing import BandPaths
from megalopta.render.scattering import Scattering
from megalopta.render.sensors.primary import Look, pixel_means
from megalopta.render.settings import RenderSettings, frame_seed
from megalopta.render.shading import Bounces, Sight, SkyLight, SunLight, Textures

SKY_EVERY, FOLLOWED_EVERY = 4, 16
"""Samples of the sun for each of the sky, and for each of other surfaces."""


class SplitPaths:
    """Frames of diffuse surfaces that do not emit, in clear air, by vectorized variants.

    Attributes
    ----------
    exposing : SplitPaths
        Integrator of frames of many poses; itself, unless another is given.
    """

    def __init__(
        self,
        whole: LoadedScene,
        settings: RenderSettings,
        layers: Layers | None = None,
        exposing: "SplitPaths | None" = None,
    ) -> None:
        scene, meshes, loaded = whole
        assert scene.lighting is not None
        self.exposing = exposing or self
        self._loaded, self._depth = loaded, settings.max_depth
        self._layers = layers or Layers(loaded)
        self._bands, self._sampler = settings.bands_nm, settings.sampler
        self._index = MeshIndex(*self._layers.scenes)
        self._textures = Textures(scene, meshes)
        scattering = Scattering([scene.materials[mesh.material] for mesh in meshes], self._bands)
        self._bounces = Bounces(scattering, len(self._bands))
        self._sky = SkyLight(scene.lighting, scattering, self._bounces, self._bands)
        sun = scene.lighting.sun
        self._sun = SunLight(scene, meshes, sun, self._bands) if sun else None
        self._paths = BandPaths(self._bands, settings.max_depth - 1, self._layers)

    def move_to(self, time_s: float) -> None:
        """Move objects to a time, where a copy of theirs is traced."""
        self._layers.move_to(time_s)

    def render(self, scene: Any, sensor: Any, seed: int, spp: int) -> NDArray[np.float32]:
        """Radiance (H, W, B) at a sensor, band means, W·m⁻²·sr⁻¹·nm⁻¹."""
        return self._taken(sensor, seed, spp)[..., : len(self._bands)]

    def measured(self, scene: Any, sensor: Any, seed: int, spp: int) -> NDArray[np.float32]:
        """Radiance, zeros and the share of the sky (H, W, 2·B + 1): no fixed error."""
        taken = self._taken(sensor, seed, spp)
        radiance, sky = np.split(taken, [len(self._bands)], axis=-1)
        return np.concatenate([radiance, np.zeros_like(radiance), sky], axis=-1)

    def _taken(self, sensor: Any, seed: int, spp: int) -> NDArray[np.float32]:
        """Radiance and the share of the sky (H, W, B + 1)."""

        def part(number: int, every: int, look: Look) -> NDArray[np.float32]:
            count = math.ceil(spp / every)
            sampler = mi.load_dict({"type": self._sampler, "sample_count": count})
            return pixel_means(sensor, sampler, frame_seed(seed, number) if number else seed, look)

        taken = part(0, 1, self._seen)
        radiance = taken[..., : len(self._bands)]
        if self._depth > 1:
            radiance += part(1, SKY_EVERY if self._sun else 1, self._skylit)
        if self._depth > 2:
            radiance += part(2, FOLLOWED_EVERY, self._followed)
        return taken

    def _seen(self, ray: Any, place: Any, sampler: Any) -> list[Any]:
        """Light of the sky behind the surfaces and of the sun on them; 1 where it is the sky."""
        sight, weight = self._look(ray)
        sky = ~sight.point.is_valid()
        light = self._sky.emitted(ray.d, sky)
        if self._sun and self._depth > 1:
            direct = self._sun.radiance(self._layers, sight, weight, sampler.next_1d())
            light = [a + b for a, b in zip(light, direct, strict=True)]
        return [*light, dr.select(sky, 1.0, 0.0)]

    def _skylit(self, ray: Any, place: Any, sampler: Any) -> list[Any]:
        """Light of the sky on the surfaces seen."""
        sight, weight = self._look(ray)
        return self._sky.radiance(self._layers, sight, weight, sampler)

    def _followed(self, ray: Any, place: Any, sampler: Any) -> list[Any]:
        """Light of other surfaces on those seen."""
        sight, weight = self._look(ray)
        rays, through = self._bounces.rays(sight, sampler.next_2d())
        blocked = sight.shaded & self._layers.ray_test(rays, sight.shaded)
        place = sampler.next_1d()
        dr.eval(sight, weight, rays, through, blocked, place)
        arriving = self._paths.radiance(self._loaded, rays, place, sampler, blocked)
        return self._bounces.reflected(sight, through, weight, place, arriving)

    def _look(self, ray: Any) -> tuple[Sight, Any]:
        """Surfaces seen along rays, and the weights of their textures."""
        hit = self._layers.ray_intersect_preliminary(ray, coherent=True)
        point = hit.compute_surface_interaction(ray, mi.RayFlags.All)
        sight = Sight(point, point.wi.z > 0, point.is_valid(), self._index.of(hit))
        return sight, self._textures.weight(sight)
