"""Sky of twilight: sunlight scattered once, by air.

The sun is below the local horizon but still shines on the air above it. Along a line of sight every
parcel of air scatters the light that reaches it past the Earth, in proportion to its density and to
Rayleigh's phase function; air and ozone dim it before and after. Multiply scattered light is nearly
uniform over the sky. At this depth of the sun it is about half of the light at the zenith
(approximate; it grows from a third at sunset to nearly all at a depth of 10°). The model: clean air
at 550 nm in spherical shells, without refraction and without aerosol, which would redden and
broaden the glow above the sunset.
"""

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from megalopta.core.arrays import Floats

SUN_DEPTH_DEG = 6.4
"""Depth of the sun below the horizon at which the twilight spectrum was measured (degrees)."""

_EARTH_KM, _TOP_KM = 6371.0, 80.0
_AIR_DEPTH, _AIR_SCALE_KM = 0.097, 8.0
"""Rayleigh optical depth of the air at 550 nm (Bodhaine et al. 1999), and its scale height."""
_OZONE_DEPTH, _OZONE_KM, _OZONE_WIDTH_KM = 0.027, 22.0, 5.0
"""Optical depth of 300 Dobson units, in a Gaussian layer."""
_EVENLY = 0.5
"""Share of multiply scattered light at the zenith."""
_STEPS, _SUN_STEPS = 80, 120


def sky(directions: Floats, sun_azimuth_rad: float) -> Floats:
    """Radiance from directions (n, 3), unit vectors above the horizon, relative to the zenith."""
    depth = np.radians(SUN_DEPTH_DEG)
    level = np.cos(depth)
    sun = np.array(
        [level * np.cos(sun_azimuth_rad), level * np.sin(sun_azimuth_rad), -np.sin(depth)]
    )
    seen = np.vstack([directions, [0.0, 0.0, 1.0]])
    up = seen[:, 2:]
    way = np.sqrt((_EARTH_KM * up) ** 2 + 2 * _EARTH_KM * _TOP_KM + _TOP_KM**2) - _EARTH_KM * up
    # Steps that grow with distance: most of the air is low.
    edges = np.linspace(0, 1, _STEPS + 1) ** 2
    distance = way * (edges[1:] + edges[:-1]) / 2
    step = way * np.diff(edges)
    x, y, z = (distance * seen[:, k, None] for k in range(3))
    radius = np.sqrt(x**2 + y**2 + (z + _EARTH_KM) ** 2)
    height = radius - _EARTH_KM
    sine = (x * sun[0] + y * sun[1] + (z + _EARTH_KM) * sun[2]) / radius
    density = np.exp(-height / _AIR_SCALE_KM) / _AIR_SCALE_KM
    transmitted = np.exp(-np.cumsum(_extinction(height) * step, axis=1))
    phase = 1 + (seen @ sun)[:, None] ** 2
    single = (density * phase * transmitted * _sunlight()((height, sine)) * step).sum(axis=1)
    return np.asarray((1 - _EVENLY) * single[:-1] / single[-1] + _EVENLY)


def _extinction(height_km: Floats) -> Floats:
    """Extinction per kilometer."""
    air = _AIR_DEPTH / _AIR_SCALE_KM * np.exp(-height_km / _AIR_SCALE_KM)
    off = (height_km - _OZONE_KM) / _OZONE_WIDTH_KM
    ozone = _OZONE_DEPTH / (_OZONE_WIDTH_KM * np.sqrt(2 * np.pi)) * np.exp(-(off**2) / 2)
    return np.asarray(air + ozone)


def _sunlight() -> RegularGridInterpolator:
    """Share of sunlight that reaches a height (km), by the sine of the sun's elevation."""
    heights = np.linspace(0, _TOP_KM, 81)
    sines = np.linspace(-0.35, 0.2, 221)
    radius = _EARTH_KM + heights[:, None, None]
    sine = sines[None, :, None]
    toward = radius * sine
    way = np.sqrt(toward**2 + (_EARTH_KM + _TOP_KM) ** 2 - radius**2) - toward
    edges = np.linspace(0, 1, _SUN_STEPS + 1)
    distance = way * (edges[1:] + edges[:-1]) / 2
    height = np.sqrt(radius**2 + distance**2 + 2 * distance * toward) - _EARTH_KM
    depth = (_extinction(height.clip(0)) * way * np.diff(edges)).sum(axis=-1)
    hidden = (sine[..., 0] < 0) & (radius[..., 0] * np.sqrt(1 - sine[..., 0] ** 2) < _EARTH_KM)
    return RegularGridInterpolator((heights, sines), np.where(hidden, 0.0, np.exp(-depth)))
