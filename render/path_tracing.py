"""Frames by paths of light, with what their error is measured by."""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.render.light_paths import LightPaths
from megalopta.render.loading.air import Air
from megalopta.render.mitsuba_loader import dr, mi
from megalopta.render.sensors.primary import developed, pixel_means

SCATTERINGS = 64
"""What the longest path of clear air grows by in haze: of 80 trees in fog of 50 m visibility, 16
more miss 0.2 % of the light in the visible and 1.6 % where leaves are bright, 32 miss 0.01 %; of
10 m, 64 miss some 3 % where leaves are bright."""
# Rays per pixel that look for the sky in scalar variants, where each takes 10 µs.
_SCALAR_RAYS = 4


class PathIntegrator:
    """Frames of which every path is traced, in clear air or through haze.

    In haze, scatterings by droplets count as hits of surfaces do.

    Attributes
    ----------
    exposing : PathIntegrator
        That of frames of many poses; itself, unless another is given.
    """

    def __init__(
        self, max_depth: int, air: Air | None = None, exposing: "PathIntegrator | None" = None
    ) -> None:
        self._air = air
        self.exposing = exposing or self
        self._is_scalar = str(mi.variant()).startswith("scalar")
        self._trace = self._tracer(max_depth)

    def _tracer(self, max_depth: int) -> Any:
        """Mitsuba's integrators where ours does not do: in haze, and a sample at a time."""
        if self._air:
            return mi.load_dict({"type": "volpath", "max_depth": max_depth + SCATTERINGS})
        if self._is_scalar:
            return mi.load_dict({"type": "path", "max_depth": max_depth})
        return LightPaths(max_depth)

    def move_to(self, time_s: float) -> None:
        """Nothing is kept that depends on the time."""

    def render(self, scene: Any, sensor: Any, seed: int, spp: int) -> NDArray[np.float32]:
        """Radiance (H, W, B) that a sensor sees, W·m⁻²·sr⁻¹·nm⁻¹.

        In haze its scene is that of the air.
        """
        if self._air:
            scene = self._air.scene
        if not self._is_scalar:
            return developed(sensor, seed, spp, partial(self._radiance, scene))
        if self._air and sensor.get_medium() is None:  # it takes one only once
            sensor.set_medium(self._air.medium)
        return np.array(self._trace.render(scene, sensor, seed=seed, spp=spp), np.float32)

    def along(
        self, scene: Any, origins: Floats, directions: Floats, wavelengths: Floats, seed: int
    ) -> NDArray[np.float64]:
        """Radiance (4, N) along rays at four wavelengths each (4, N), W·m⁻²·sr⁻¹·nm⁻¹.

        Rays start at origins (3, N), m, in unit directions (3, N).
        """
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, 1 if self._is_scalar else origins.shape[1])
        if self._air:
            scene = self._air.scene

        def light(origin: Any, direction: Any, wavelength: Any) -> NDArray[np.float64]:
            start, toward = mi.Point3f(origin), mi.Vector3f(direction)
            rays: Any = mi.RayDifferential3f(start, toward)
            rays.wavelengths = mi.Spectrum(wavelength)
            return np.array(self._radiance(scene, sampler, rays)[0], np.float64)

        if self._is_scalar:
            each = zip(
                origins.T.tolist(), directions.T.tolist(), wavelengths.T.tolist(), strict=True
            )
            return np.stack([light(*ray) for ray in each], axis=-1)
        return light(*(values.astype(np.float32) for values in (origins, directions, wavelengths)))

    def _radiance(self, scene: Any, sampler: Any, rays: Any) -> tuple[Any, Any]:
        if not self._air and not self._is_scalar:
            found: tuple[Any, Any] = self._trace.radiance(scene, sampler, rays)
            return found
        medium = self._air.medium if self._air else None
        light, valid, _ = self._trace.sample(scene, sampler, rays, medium)
        return light, valid

    def measured(self, scene: Any, sensor: Any, seed: int, spp: int) -> NDArray[np.float32]:
        """Radiance, zeros and the share of the sky (H, W, 2·B + 1): nothing stands."""
        radiance = self.render(scene, sensor, seed, spp)
        if self._is_scalar:
            sky = _scalar_sky(scene, sensor, seed)
        else:
            sky = pixel_means(sensor, seed, spp, lambda ray, *_: [self._sky(scene, ray)])
        return np.concatenate([radiance, np.zeros_like(radiance), sky], axis=-1)

    def _sky(self, scene: Any, ray: Any) -> Any:
        return dr.select(scene.ray_test(ray), 0.0, 1.0)


def _scalar_sky(scene: Any, sensor: Any, seed: int) -> NDArray[np.float32]:
    width, height = (int(size) for size in sensor.film().crop_size())
    jitter = np.random.default_rng(seed).random((height, width, _SCALAR_RAYS, 3))

    def free(row: int, column: int) -> Iterator[bool]:
        for x, y, time in jitter[row, column].tolist():
            place = mi.Point2f((column + x) / width, (row + y) / height)
            ray, _ = sensor.sample_ray(time, 0.5, place, mi.Point2f(0.5))
            yield not scene.ray_test(ray)

    shares = [[sum(free(row, column)) for column in range(width)] for row in range(height)]
    return np.array(shares, np.float32)[..., None] / np.float32(_SCALAR_RAYS)
