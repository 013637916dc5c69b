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
from numpy.typing import NDArray

from megalopta.scenes.spectra.spectrum import Spectrum

WAVELENGTHS_NM = tuple(map(float, range(360, 1801, 20)))

# fmt: off
_ABOVE = (
    1.06, 1.08, 1.44, 1.70, 1.78, 2.02, 1.98, 1.93, 1.85, 1.87, 1.84, 1.82, 1.77, 1.69, 1.62,
    1.54, 1.49, 1.43, 1.35, 1.30, 1.25, 1.20, 1.13, 1.09, 1.03, 0.970, 0.948, 0.916, 0.879, 0.844,
    0.802, 0.773, 0.741, 0.706, 0.675, 0.644, 0.616, 0.590, 0.574, 0.555, 0.535, 0.516, 0.499,
    0.483, 0.464, 0.448, 0.431, 0.414, 0.395, 0.380, 0.368, 0.357, 0.345, 0.332, 0.322, 0.312,
    0.301, 0.293, 0.285, 0.276, 0.267, 0.256, 0.249, 0.240, 0.230, 0.223, 0.212, 0.207, 0.198,
    0.187, 0.183, 0.176, 0.170,
)
_DIRECT = (
    0.384, 0.466, 0.720, 0.940, 1.07, 1.30, 1.33, 1.35, 1.32, 1.36, 1.35, 1.33, 1.32, 1.30, 1.29,
    1.25, 1.22, 1.17, 1.04, 1.11, 0.870, 1.07, 0.999, 0.851, 0.909, 0.889, 0.872, 0.700, 0.632,
    0.287, 0.416, 0.630, 0.690, 0.662, 0.634, 0.597, 0.562, 0.472, 0.174, 0.177, 0.313, 0.409,
    0.419, 0.431, 0.441, 0.393, 0.396, 0.360, 0.273, 0.129, 0.00071, 0.000156, 0.000612, 0.0174,
    0.0413, 0.0862, 0.0956, 0.203, 0.254, 0.264, 0.258, 0.235, 0.233, 0.230, 0.219, 0.211, 0.204,
    0.195, 0.179, 0.160, 0.146, 0.0995, 0.0349,
)
_SKY = (
    0.203, 0.207, 0.253, 0.284, 0.286, 0.295, 0.264, 0.231, 0.206, 0.190, 0.171, 0.152, 0.136,
    0.126, 0.114, 0.103, 0.0903, 0.0824, 0.0713, 0.0696, 0.0575, 0.0583, 0.0539, 0.0439, 0.0437,
    0.0422, 0.0380, 0.0289, 0.0243, 0.0133, 0.0188, 0.0232, 0.0242, 0.0228, 0.0213, 0.0198, 0.0174,
    0.0134, 0.00587, 0.00557, 0.00926, 0.0108, 0.0107, 0.0108, 0.0106, 0.00957, 0.00912, 0.00859,
    0.00689, 0.00331, 0.00108, 0.000522, 0.000234, 0.000612, 0.00105, 0.00176, 0.00223, 0.00373,
    0.00471, 0.00459, 0.00423, 0.00402, 0.00371, 0.00369, 0.00365, 0.00343, 0.00321, 0.00295,
    0.00269, 0.00238, 0.00180, 0.00118, 0.000617,
)
# fmt: on

_SUN_HEIGHT = 1 / 1.5
"""Sine of the sun's elevation at an air mass of 1.5."""

ABOVE_ATMOSPHERE = Spectrum(WAVELENGTHS_NM, _ABOVE)
"""Irradiance of a plane facing the sun above the atmosphere, W·m⁻²·nm⁻¹."""

SUN = Spectrum(WAVELENGTHS_NM, _DIRECT)
"""Irradiance of a plane facing the sun on the ground, from the sun alone, W·m⁻²·nm⁻¹."""

CLEAR_SKY = Spectrum(WAVELENGTHS_NM, _SKY)
"""Irradiance of a horizontal plane by the clear sky alone, W·m⁻²·nm⁻¹."""


def transmission() -> NDArray[np.float64]:
    """Share of the light above the atmosphere that reaches the ground, straight or scattered."""
    above = _SUN_HEIGHT * np.array(_ABOVE)
    return np.asarray((_SUN_HEIGHT * np.array(_DIRECT) + np.array(_SKY)) / above)


_MOON_NM = (
    *(350.0, 405.0, 441.6, 486.9, 549.1, 665.1, 745.3, 774.8, 865.3, 928.4),
    *(1059.5, 1243.2, 1538.7, 1633.6, 1981.5),
)
# fmt: off
FULL_MOON = Spectrum(_MOON_NM, (
    0.600, 0.798, 0.800, 0.878, 0.998, 1.218, 1.237, 1.310, 1.371, 1.350,
    1.513, 1.606, 1.881, 1.904, 2.071,
))
"""Reflectance of the disc at a phase of 7°, 1 at 550 nm."""
QUARTER_MOON = Spectrum(_MOON_NM, (
    0.506, 0.716, 0.744, 0.844, 0.998, 1.275, 1.338, 1.430, 1.531, 1.534,
    1.712, 1.925, 2.390, 2.479, 2.810,
))
"""The same at a phase of 90°, where it is a tenth as bright."""
# fmt: on


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
