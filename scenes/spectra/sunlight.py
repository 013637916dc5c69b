"""Sunlight: straight, from the clear sky, at twilight, and from the moon.

Sunlight: above the atmosphere, straight from the sun on the ground, and from the clear sky. All
three are means over 20 nm, at 360 to 1800 nm. Above the atmosphere and straight from the sun: the
reference spectra of ASTM G173-03 (air mass 1.5, 1.42 cm of precipitable water, an aerosol optical
depth of 0.084 at 500 nm); direct light includes the brightness around the sun. The sky on a
horizontal plane: the clear-sky model of Bird and Riordan (1986, J. Climate Appl. Meteor. 25, 87)
for the same atmosphere and a ground that reflects 0.2; its direct light is within 3 % of the
standard's in bands of 200 nm, but for that of water at 1300 to 1500 nm, where it is a quarter more.

The bands of water vapor at 940, 1130 and 1380 nm are deep and hang on the weather: with 5 cm of
water, as in the tropics, they take up to twice as much of what is left beside them.

Moonlight: what the lunar disc reflects of sunlight, straight or scattered by the sky. The disc's
reflectance is the model of Kieffer and Stone (2005, AJ 129, 2887, Eq. 10 and Table 4) at phases of
7° and 90°, without libration, relative to that at 550 nm: a waning moon is redder. The atmosphere
does to moonlight what it does to sunlight.

Check that was not put in: 200 mlux of a full moon then come with 890 µW/m² at 0.8 to 1.7 µm, where
up to 600 were measured on the ground, through an air of unknown humidity (Krieg 2021,
doi:10.1038/s41598-021-98060-2).

Twilight: the sky's zenith with the sun 6.4° below the horizon, when the ground gets 1 lux.
Magnitudes in U, B, V, R and I are the fits of Patat, Ugolnikov and Postylyakov (2006, A&A 455, 385,
Table 1) to the zenith over Paranal, with the wavelengths and zero points of Bessell et al. (1998,
A&A 333, 231): a sky of that brightness gives 1.0 lux. Beyond I it is sunlight on the ground times
λ⁻⁴, the scattering of air. So it meets airglow where that was seen to happen: at a depression of
9.3° in J and 7.4° in H (Dome A, arXiv:2607.01923). The broad bands hide what ozone takes at 600 nm.

Where the sun went down the sky is several times as bright; here it is the same everywhere.
"""

import math

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.scenes.spectra.spectrum import TABLES, Spectrum

WAVELENGTHS_NM = tuple(map(float, range(360, 1801, 20)))

_ABOVE, _DIRECT, _SKY = (TABLES[name] for name in ("above atmosphere", "direct", "sky"))

_SUN_HEIGHT = 1 / 1.5
"""Sine of the sun's elevation at an air mass of 1.5."""

ABOVE_ATMOSPHERE = Spectrum(WAVELENGTHS_NM, _ABOVE)
"""Irradiance of a plane facing the sun above the atmosphere, W·m⁻²·nm⁻¹."""

SUN = Spectrum(WAVELENGTHS_NM, _DIRECT)
"""Irradiance of a plane facing the sun on the ground, from the sun alone, W·m⁻²·nm⁻¹."""

CLEAR_SKY = Spectrum(WAVELENGTHS_NM, _SKY)
"""Irradiance of a horizontal plane by the clear sky alone, W·m⁻²·nm⁻¹."""


def transmission() -> Floats:
    """Share of the light above the atmosphere that reaches the ground, straight or scattered."""
    above = _SUN_HEIGHT * np.array(_ABOVE)
    return np.asarray((_SUN_HEIGHT * np.array(_DIRECT) + np.array(_SKY)) / above)


FULL_MOON = Spectrum(TABLES["moon nm"], TABLES["full moon"])
"""Reflectance of the disc at a phase of 7°, 1 at 550 nm."""
QUARTER_MOON = Spectrum(TABLES["moon nm"], TABLES["quarter moon"])
"""The same at a phase of 90°, where it is a tenth as bright."""


def moonlit(sunlit: Spectrum, disc: Spectrum) -> Spectrum:
    """Relative spectrum of what the moon lights, of what the sun would and the disc's reflectance.

    Values at the wavelengths of the first.
    """
    values = np.array(sunlit.values) * disc(sunlit.wavelengths_nm)
    return Spectrum(sunlit.wavelengths_nm, tuple(map(float, values)))


_ZENITH_DISTANCE_DEG = 96.4
_I_NM = 798.0
# Wavelength, nm; zero point, W·m⁻²·µm⁻¹; magnitude per square arcsecond at 95°, its first and
# second derivative by the sun's zenith distance, the latter halved.
_BANDS = (
    (366.0, 4.175e-8, 11.78, 1.376, -0.039),
    (438.0, 6.320e-8, 11.84, 1.411, -0.041),
    (545.0, 3.631e-8, 11.84, 1.518, -0.057),
    (641.0, 2.177e-8, 11.40, 1.567, -0.064),
    (_I_NM, 1.126e-8, 10.93, 1.470, -0.062),
)
_ARCSEC2_SR = math.radians(1 / 3600) ** 2


def _zenith(zero_point: float, *magnitudes: float) -> float:
    """Radiance, W·m⁻²·sr⁻¹·nm⁻¹."""
    magnitude = np.polynomial.polynomial.polyval(_ZENITH_DISTANCE_DEG - 95, magnitudes)
    return float(zero_point / 1000 * 10 ** (-0.4 * magnitude) / _ARCSEC2_SR)


def _twilight() -> Spectrum:
    grid = np.array(WAVELENGTHS_NM)
    scattered = ABOVE_ATMOSPHERE(grid) * transmission() * (grid / _I_NM) ** -4
    measured = [(wavelength, _zenith(*band)) for wavelength, *band in _BANDS]
    scale = measured[-1][1] / float(np.interp(_I_NM, grid, scattered))
    beyond = [(x, float(y)) for x, y in zip(grid, scale * scattered, strict=True) if x > _I_NM]
    wavelengths, values = zip(*measured, *beyond, strict=True)
    return Spectrum(tuple(map(float, wavelengths)), tuple(values))


TWILIGHT = _twilight()
"""Radiance of the zenith, W·m⁻²·sr⁻¹·nm⁻¹."""
