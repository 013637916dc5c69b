"""Paths along some of the rays of a frame: those to surfaces whose light is not baked."""

from typing import Any

from megalopta.render import RenderSettings, dr, mi
from megalopta.render.baking.gathering import wavelength_groups
from megalopta.render.baking.sampling import cell_sampler
from megalopta.render.light_paths import LightPaths


class Paths:
    """Mitsuba's path tracer, for whichever rays are asked for."""

    def __init__(self, settings: RenderSettings) -> None:
        self._bands = settings.bands_nm
        self._paths = LightPaths(settings.max_depth)

    def radiance(self, scene: Any, ray: Any, place: Any, sampler: Any, active: Any) -> list[Any]:
        """Radiance of each band along those of N rays that are active; 0 along others.

        `place` is that of the wavelength in its band. They are traced apart from the others, with
        random numbers that follow from one of the sampler's.
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
