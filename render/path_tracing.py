"""Mitsuba's path tracer, with what its error is measured by."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.render.loading import Air
from megalopta.render.mitsuba_loader import dr, mi
from megalopta.render.sensors import pixel_means

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
        kind, depth = ("volpath", max_depth + SCATTERINGS) if air else ("path", max_depth)
        self._integrator = mi.load_dict({"type": kind, "max_depth": depth})

    def move_to(self, time_s: float) -> None:
        """Nothing is kept that depends on the time."""

    def render(self, scene: Any, sensor: Any, seed: int, spp: int) -> NDArray[np.float32]:
        """Radiance (H, W, B) that a sensor sees, W·m⁻²·sr⁻¹·nm⁻¹.

        The integrator is called itself: `mi.render` wraps it for differentiation, and that wrapper
        turns Ctrl-C into a RuntimeError. In haze its scene is that of the air.
        """
        if self._air:
            scene = self._air.scene
            if sensor.get_medium() is None:  # it takes one only once
                sensor.set_medium(self._air.medium)
        return np.array(self._integrator.render(scene, sensor, seed=seed, spp=spp), np.float32)

    def measured(self, scene: Any, sensor: Any, seed: int, spp: int) -> NDArray[np.float32]:
        """Radiance, zeros and the share of the sky (H, W, 2·B + 1): nothing stands."""
        radiance = self.render(scene, sensor, seed, spp)
        if str(mi.variant()).startswith("scalar"):
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
