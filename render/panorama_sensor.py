"""Mitsuba's panoramic sensor, which Mitsuba has not: equirectangular or cylindrical.

Written in Python, it costs vectorized variants nothing, because they trace it into their kernel
once; scalar variants call it for every sample, which takes a few microseconds of one core each.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import drjit as dr
import mitsuba as mi

NAME = "panorama"


@cache
def register_panorama(variant: str) -> None:
    """Make the sensor known to the active variant, given by its name."""
    is_vectorized = not variant.startswith("scalar")

    class PanoramaSensor(mi.Sensor):
        """Rays from one point, uniform in azimuth and in height on the film.

        Plugin parameters: `fov`, the azimuth (rad) from the left to the right edge, and
        `is_cylinder`, whether height is the tangent of elevation or elevation itself. Through
        `mi.traverse` one sets `to_world` and `heights`, those of the lower and upper edge in focal
        lengths; that compiles nothing again.
        """

        def __init__(self, properties: Any) -> None:
            super().__init__(properties)
            self.to_world = mi.Transform4f()
            self.fov = properties["fov"]
            self.is_cylinder = properties["is_cylinder"]
            # Not two numbers: scalar variants can change only Mitsuba's own objects.
            self.heights = mi.Point2f(0)

        def traverse(self, callback: Any) -> None:
            super().traverse(callback)
            for name in ("to_world", "heights"):
                callback.put(name, getattr(self, name), mi.ParamFlags.NonDifferentiable)

        def parameters_changed(self, keys: Sequence[str] = ()) -> None:
            if is_vectorized:  # else the values would be written into the kernel
                dr.make_opaque(self.to_world, self.heights)

        def sample_ray(
            self, time: Any, sample1: Any, sample2: Any, sample3: Any, active: Any = True
        ) -> tuple[Any, Any]:
            surface = dr.zeros(mi.SurfaceInteraction3f)
            wavelengths, weight = self.sample_wavelengths(surface, sample1, active)
            sine, cosine = dr.sincos(self.fov * (sample2.x - 0.5))
            height = dr.lerp(self.heights.y, self.heights.x, sample2.y)
            if self.is_cylinder:
                radius, rise = dr.rsqrt(1 + height * height), height * dr.rsqrt(1 + height * height)
            else:
                rise, radius = dr.sincos(height)
            # Mitsuba's +x is to the left of its +z.
            direction = mi.Vector3f(-radius * sine, rise, radius * cosine)
            origin = self.to_world @ mi.Point3f(0, 0, 0)
            ray = mi.Ray3f(origin, self.to_world @ direction, time, wavelengths)
            return ray, weight

        def sample_ray_differential(
            self, time: Any, sample1: Any, sample2: Any, sample3: Any, active: Any = True
        ) -> tuple[Any, Any]:
            ray, weight = self.sample_ray(time, sample1, sample2, sample3, active)
            return mi.RayDifferential3f(ray), weight

        def to_string(self) -> str:
            return f"PanoramaSensor[film = {self.film()}]"

    mi.register_sensor(NAME, PanoramaSensor)
