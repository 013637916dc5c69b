"""Mitsuba's panoramic sensor, which Mitsuba has not: equirectangular or cylindrical."""

from collections.abc import Sequence
from functools import cache
from typing import Any

from megalopta.render import dr, mi
from megalopta.render.sensors.base import python_sensor

PANORAMA = "panorama"


@cache
def register_panorama(variant: str) -> None:
    """Make the sensor known to the active variant, given by its name."""
    is_vectorized = not variant.startswith("scalar")

    class PanoramaSensor(python_sensor()):  # type: ignore[misc]
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

    mi.register_sensor(PANORAMA, PanoramaSensor)
