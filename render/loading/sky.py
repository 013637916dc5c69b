"""Non-uniform sky inside Mitsuba: a sum of patterns, each with its own spectrum.

Mitsuba's environment map has three colors from 360 to 830 nm, and a scene accepts only one.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter

from megalopta.render import dr, mi
from megalopta.render.loading.materials import bitmap, mean, spectrum
from megalopta.render.mitsuba_loader import PlugIn, is_scalar, plug_in
from megalopta.scenes.scene import Lighting, SkyPattern

_DISTANCE_M = 1e6
"""Distance of the points that represent directions."""


class SkyPatterns:
    """Patterns of a sky, evaluated along directions."""

    def __init__(self, patterns: Sequence[SkyPattern]) -> None:
        self.textures = [mi.load_dict(bitmap(sky.pattern)) for sky in patterns]
        self._rows = [len(sky.pattern) for sky in patterns]

    def toward(self, direction: Any, active: Any) -> list[Any]:
        """Value of each pattern in directions; constant beyond its first and last row."""
        place, values = place_of(direction), []
        for texture, rows in zip(self.textures, self._rows, strict=True):
            half, at = 0.5 / rows, _zeros(mi.SurfaceInteraction3f)
            at.uv = mi.Point2f(place.x, dr.clip(place.y, half, 1 - half))
            values.append(texture.eval_1(at, active))
        return values


def place_of(direction: Any) -> Any:
    """Position of a direction in a pattern, (u, v) from 0 to 1."""
    azimuth = dr.atan2(direction.y, direction.x)
    return mi.Point2f(0.5 - azimuth / dr.two_pi, dr.safe_acos(direction.z) / dr.pi)


def _zeros(kind: Any) -> Any:
    return kind() if is_scalar() else dr.zeros(kind)


class EvenDirections:
    """Random directions all around."""

    tables: tuple[Any, ...] = ()

    def sample(self, point: Any, sample: Any, active: Any) -> tuple[Any, Any]:
        """Return a direction for two random numbers, and its density per solid angle."""
        return mi.warp.square_to_uniform_sphere(sample), mi.Float(1 / (4 * dr.pi))

    def density(self, point: Any, direction: Any, active: Any) -> Any:
        """Probability density of a direction, per solid angle."""
        return mi.Float(1 / (4 * dr.pi))


class BrightDirections:
    """Random directions to where a sky with patterns is bright, the same from all points."""

    def __init__(self, lighting: Lighting) -> None:
        rows = max(len(part.pattern) for part in lighting.patterns)
        chance = np.full((rows, 2 * rows), mean(lighting.sky))
        for part in lighting.patterns:
            near = maximum_filter(part.pattern, 3, mode=("nearest", "wrap")) * mean(part.radiance)
            of_row, of_column = (np.arange(n) * len(near) // rows for n in (rows, 2 * rows))
            chance += near[of_row][:, of_column]
        sine = np.sin(np.pi * (np.arange(rows) + 0.5) / rows)
        chances = np.asarray(chance * sine[:, None] / chance.max(), np.float32)
        self._texels = mi.DiscreteDistribution2D(chances)
        self.tables = [self._texels]
        self._rows, self._columns = chances.shape

    def sample(self, point: Any, sample: Any, active: Any) -> tuple[Any, Any]:
        """Return a direction for two random numbers, and its density per solid angle."""
        texel, chance, within = self._texels.sample(sample, active)
        azimuth = dr.pi - dr.two_pi * (texel.x + within.x) / self._columns
        sine, z = dr.sincos(dr.pi * (texel.y + within.y) / self._rows)
        direction = mi.Vector3f(sine * dr.cos(azimuth), sine * dr.sin(azimuth), z)
        return direction, chance * self._texels_per(z)

    def density(self, point: Any, direction: Any, active: Any) -> Any:
        """Probability density of a direction, per solid angle."""
        place = place_of(direction)
        column = dr.minimum(mi.UInt32(place.x * self._columns), self._columns - 1)
        row = dr.minimum(mi.UInt32(place.y * self._rows), self._rows - 1)
        texel = mi.Point2u(column, row)
        return self._texels.pdf(texel, active) * self._texels_per(direction.z)

    def _texels_per(self, z: Any) -> Any:
        sine = dr.maximum(dr.safe_sqrt(1 - z * z), 1e-6)
        return self._rows * self._columns / (2 * dr.pi**2 * sine)


def sky_light(lighting: Lighting, weight: float) -> Any:
    """Mitsuba emitter of a sky, in the active variant; None if it is dark.

    `weight` says how often light paths look for it, over how often for the sun.
    """
    if not lighting.patterns and not max(lighting.sky.values):
        return None
    if is_scalar() and not lighting.patterns:  # Python is called for each ray
        even = {"type": "constant", "radiance": spectrum(lighting.sky)}
        return mi.load_dict({**even, "sampling_weight": weight})
    return plug_in(_Sky)(lighting, weight)


def sky_of(scene: Any) -> Any:
    """Sky of a loaded scene, to be aimed; None without one."""
    return next((light for light in scene.emitters() if hasattr(light, "directions")), None)


class _Sky(PlugIn):
    """Sky of a lighting, as an emitter."""

    base = "Emitter"

    def __init__(self, lighting: Lighting, weight: float) -> None:
        properties: Any = mi.Properties()
        properties["sampling_weight"] = weight
        self.above.__init__(self, properties)
        self.m_flags = mi.EmitterFlags.Infinite | mi.EmitterFlags.SpatiallyVarying
        self.even = mi.load_dict(spectrum(lighting.sky))
        self.spectra = [mi.load_dict(spectrum(part.radiance)) for part in lighting.patterns]
        self.patterns = SkyPatterns(lighting.patterns)
        self.aim(BrightDirections(lighting) if lighting.patterns else EvenDirections())

    def aim(self, directions: Any) -> None:
        """Set the random directions in which light paths look for the sky."""
        self.directions = directions
        # Dr.Jit looks only here for what a recorded function reads.
        self.held = [*directions.tables, *self.patterns.textures]

    def toward(self, at: Any, direction: Any, active: Any) -> Any:
        """Radiance from a direction, at the wavelengths of a point."""
        point = _zeros(mi.SurfaceInteraction3f)
        point.wavelengths = at.wavelengths
        radiance = self.even.eval(point, active)
        values = self.patterns.toward(direction, active)
        for color, value in zip(self.spectra, values, strict=True):
            radiance += color.eval(point, active) * value
        return dr.select(active, radiance, 0.0)

    def eval(self, si: Any, active: Any = True) -> Any:
        return self.toward(si, -si.wi, active)

    def sample_direction(self, it: Any, sample: Any, active: Any = True) -> Any:
        drawn = _zeros(mi.DirectionSample3f)
        drawn.d, drawn.pdf = self.directions.sample(it.p, sample, active)
        drawn.p = it.p + _DISTANCE_M * drawn.d
        drawn.n = -drawn.d
        drawn.dist, drawn.time, drawn.delta = _DISTANCE_M, it.time, False
        drawn.emitter = self if is_scalar() else mi.EmitterPtr(self)
        active = active & (drawn.pdf > 0)
        weight = dr.select(active, dr.rcp(drawn.pdf), 0.0)
        return drawn, self.toward(it, drawn.d, active) * weight

    def pdf_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
        return self.directions.density(it.p, ds.d, active)

    def eval_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
        return self.toward(it, ds.d, active)

    def bbox(self) -> Any:
        return mi.ScalarBoundingBox3f()
