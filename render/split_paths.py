"""Path tracing that splits the light of the surfaces seen into parts, each with its own samples.

The best numbers of samples are in proportion to the root of variance over cost. Light from the disc
of sun or moon takes one more ray and is most of the light and noise. Light from the sky takes one
ray; light from other surfaces a path, ten times as much work, and brings a tenth of the light.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.render import dr, mi, shading
from megalopta.render.film import Look, pixel_means
from megalopta.render.loading.meshes import MergedMesh
from megalopta.render.loading.scene import Layers, LoadedScene, MeshIndex
from megalopta.render.mitsuba_loader import is_scalar
from megalopta.render.path_tracing import BandPaths
from megalopta.render.settings import RenderSettings, part_seed
from megalopta.scenes.scene import Scene

_SKY_EVERY, _FOLLOWED_EVERY = 4, 16
"""Samples of the sun for each of the sky, and for each of other surfaces."""


class Part(NamedTuple):
    """Part of the light, found for one in so many samples of a pixel.

    `look` returns the radiance of each band, and 1 where a ray meets the sky.
    """

    every: int
    look: Look


def can_split(scene: Scene, meshes: Sequence[MergedMesh]) -> bool:
    """True if a scene's light can be split: of diffuse surfaces in clear air that do not emit."""
    materials = [scene.materials[mesh.material] for mesh in meshes]
    is_plain = not any(look.emission or look.finish for look in materials)
    lit = scene.lighting is not None and bool(meshes)
    return lit and is_plain and not (scene.haze or is_scalar())


class SplitPaths:
    """Frames of diffuse surfaces that do not emit, in clear air, by vectorized variants."""

    def __init__(
        self, whole: LoadedScene, settings: RenderSettings, layers: Layers | None = None
    ) -> None:
        scene, meshes, loaded = whole
        assert scene.lighting is not None
        self._loaded, self._depth = loaded, settings.max_depth
        self._layers = layers or Layers(loaded)
        self._bands, self._sampler = settings.bands_nm, settings.sampler
        self._index = MeshIndex(*self._layers.scenes)
        self._textures = shading.Textures(scene, meshes)
        scattering = shading.Scattering(
            [scene.materials[mesh.material] for mesh in meshes], self._bands
        )
        self._bounces = shading.Bounces(scattering, len(self._bands))
        self._sky = shading.SkyLight(scene.lighting, scattering, self._bounces, self._bands)
        sun = scene.lighting.sun if settings.max_depth > 1 else None
        self._sun = shading.SunLight(scene, meshes, sun, self._bands) if sun else None
        self._paths = BandPaths(self._bands, settings.max_depth - 1, self._layers)

    # Found anew: a scene in a cycle of references would be freed while paths are traced.
    @property
    def parts(self) -> Sequence[Part]:
        """Parts of the light, which add up."""
        parts = (
            Part(1, self._seen),
            Part(_SKY_EVERY if self._sun else 1, self._skylit),
            Part(_FOLLOWED_EVERY, self._followed),
        )
        return parts[: self._depth]

    def move_to(self, time_s: float) -> None:
        """Move objects to a time, where a copy of theirs is traced."""
        self._layers.move_to(time_s)

    def render(self, scene: Any, sensor: Any, seed: int, spp: int) -> NDArray[np.float32]:
        """Radiance (H, W, B) at a sensor, band means, W·m⁻²·sr⁻¹·nm⁻¹."""
        return self.measured(scene, sensor, seed, spp)[..., : len(self._bands)]

    def measured(self, scene: Any, sensor: Any, seed: int, spp: int) -> NDArray[np.float32]:
        """Radiance and the share of the sky (H, W, B + 1)."""
        images = []
        for number, part in enumerate(self.parts):
            samples = {"type": self._sampler, "sample_count": math.ceil(spp / part.every)}
            own_seed = part_seed(seed, "light path", number) if number else seed
            images.append(pixel_means(sensor, mi.load_dict(samples), own_seed, part.look))
        radiance = sum(image[..., :-1] for image in images)
        return np.concatenate([radiance, images[0][..., -1:]], axis=-1)

    def _seen(self, ray: Any, place: Any, sampler: Any) -> list[Any]:
        """Light of the sky behind the surfaces, and of the sun on them."""
        sight, weights = self._look(ray)
        light = self._sky.emitted(ray.d, ~sight.point.is_valid())
        if self._sun:
            direct = self._sun.radiance(self._layers, sight, weights, sampler.next_1d())
            light = [a + b for a, b in zip(light, direct, strict=True)]
        return [*light, sight.sky]

    def _skylit(self, ray: Any, place: Any, sampler: Any) -> list[Any]:
        """Light of the sky on the surfaces seen."""
        sight, weights = self._look(ray)
        light = self._sky.radiance(self._layers, sight, weights, sampler)
        return [*light, sight.sky]

    def _followed(self, ray: Any, place: Any, sampler: Any) -> list[Any]:
        """Light of other surfaces on those seen."""
        sight, weights = self._look(ray)
        rays, through = self._bounces.rays(sight, sampler.next_2d())
        blocked = sight.shaded & self._layers.ray_test(rays, sight.shaded)
        place = sampler.next_1d()
        dr.eval(sight, weights, rays, through, blocked, place)
        arriving = self._paths.radiance(self._loaded, rays, place, sampler, blocked)
        light = self._bounces.reflected(sight, through, weights, place, arriving)
        return [*light, sight.sky]

    def _look(self, ray: Any) -> tuple[shading.Sight, shading.Weights]:
        """Surfaces seen along rays, and the weights of their textures."""
        hit = self._layers.ray_intersect_preliminary(ray, coherent=True)
        point = hit.compute_surface_interaction(ray, mi.RayFlags.All)
        sight = shading.Sight(point, point.wi.z > 0, point.is_valid(), self._index.of(hit))
        return sight, self._textures.weights(sight)
