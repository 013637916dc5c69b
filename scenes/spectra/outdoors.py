"""Spectra of outdoor light, by day and at night, through clear air and clouds.

Sunlight, the moon's disc, the night sky and water are tables: `tables.yaml` has their sources.

Moonlight is sunlight reflected by the lunar disc, direct or scattered by the sky: the atmosphere
acts on it as on sunlight.

Twilight is the sky's zenith with the sun 6.4° below the horizon, when the ground receives 1 lux.
Magnitudes in U, B, V, R and I are the fits of Patat, Ugolnikov and Postylyakov (2006, A&A 455, 385,
Table 1) to the zenith over Paranal, with the wavelengths and zero points of Bessell et al. (1998,
A&A 333, 231): a sky of that brightness gives 1.0 lux. Beyond I it is sunlight on the ground times
λ⁻⁴, the scattering of air. So it equals airglow where that was observed: at a depression of 9.3° in
J and 7.4° in H (Dome A, arXiv:2607.01923). The broad bands hide the ozone absorption at 600 nm.
Above the sunset the sky is several times as bright; here it is uniform.

The moonless night sky is starlight, zodiacal light and airglow. Means over the whole sky above the
atmosphere, in S10, stars of tenth magnitude in V per square degree (27.78 mag·arcsec⁻²):

- all stars and their light scattered by dust: 105 (Roach and Gordon 1973, The Light of the Night
  Sky), with the assumed color of a black body of 4500 K;
- zodiacal light: 140 − 90·sin|β| up to an ecliptic latitude β of 60°, and 60 beyond (Benn and
  Ellison 1998, La Palma Technical Note 115), whose mean is 96; sunlight, reddened by
  1 + 0.6·lg(λ/500 nm) (Leinert et al. 1998, A&AS 127, 1, Eq. 22, at an elongation of 90°).

The atmosphere attenuates both as it does sun and sky together. The Milky Way is three times as
bright as the mean, the pole of the ecliptic has 60; here the sky is uniform.

Airglow is the moonless zenith without 75 S10 of zodiacal light and scattered starlight (Benn and
Ellison 1998; bright stars and the Milky Way were avoided). That is 220 S10 at V, where they give
145 to 270, from minimum to maximum solar activity; the table was measured near maximum. Real
airglow changes by a factor of two within a night, grows toward the horizon by up to a factor of six
(van Rhijn) and has moving waves; here it is uniform.

Water droplets hardly absorb below 1.2 µm. At longer wavelengths, light that crosses a thick layer
of cloud meets enough of them to lose much. Two streams of diffuse light, up and down (Meador and
Weaver 1980, J. Atmos. Sci. 37, 630, quadrature): T = k/(k·cosh kτ + γ₁·sinh kτ), k² = γ₁² − γ₂², γ₁
= √3·(2 − ω·(1 + g))/2, γ₂ = √3·ω·(1 − g)/2. Droplets much larger than the wavelength absorb 1 − ω =
0.85·α·r (Bohren and Barkstrom 1974), with the absorption α of water. A stratus: τ = 30, r = 8 µm, g
= 0.86; the ground reflects nothing.
"""

import math
from dataclasses import replace

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.scenes.spectra.spectrum import TABLES, Spectrum, common_range, planckian

WAVELENGTHS_NM = tuple(map(float, range(360, 1801, 20)))
_KNOWN_NM = WAVELENGTHS_NM[0], WAVELENGTHS_NM[-1]
"""Range of twilight and night, too, whose shortest band is U, broad and centered at 366 nm."""

_ABOVE, _DIRECT, _SKY = (TABLES[name] for name in ("above atmosphere", "direct", "sky"))

_SUN_HEIGHT = 1 / 1.5
"""Sine of the sun's elevation at an air mass of 1.5."""

ABOVE_ATMOSPHERE = Spectrum(WAVELENGTHS_NM, _ABOVE)
"""Irradiance of a plane facing the sun above the atmosphere, W·m⁻²·nm⁻¹."""

SUN = Spectrum(WAVELENGTHS_NM, _DIRECT)
"""Direct irradiance of a plane on the ground facing the sun, W·m⁻²·nm⁻¹."""

CLEAR_SKY = Spectrum(WAVELENGTHS_NM, _SKY)
"""Irradiance of a horizontal plane by the clear sky alone, W·m⁻²·nm⁻¹."""


def transmission() -> Floats:
    """Share of the light above the atmosphere that reaches the ground, direct or scattered."""
    above = _SUN_HEIGHT * np.array(_ABOVE)
    return np.asarray((_SUN_HEIGHT * np.array(_DIRECT) + np.array(_SKY)) / above)


FULL_MOON = Spectrum(TABLES["moon nm"], TABLES["full moon"])
"""Reflectance of the disc at a phase of 7°, 1 at 550 nm."""
QUARTER_MOON = Spectrum(TABLES["moon nm"], TABLES["quarter moon"])
"""Reflectance of the disc at a phase of 90°, where it is a tenth as bright."""


def moonlit(sunlit: Spectrum, disc: Spectrum) -> Spectrum:
    """Relative spectrum of moonlight, from that of sunlight and the disc's reflectance.

    Values are at the wavelengths of the first.
    """
    wavelengths = sunlit.wavelengths_nm
    values = np.array(sunlit.values) * disc(wavelengths)
    return Spectrum.of(wavelengths, values, common_range([sunlit, disc]))


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


def _twilight() -> Spectrum:
    grid = np.array(WAVELENGTHS_NM)
    scattered = ABOVE_ATMOSPHERE(grid) * transmission() * (grid / _I_NM) ** -4
    measured = []
    for _, zero_point, *magnitudes in _BANDS:
        magnitude = np.polynomial.polynomial.polyval(_ZENITH_DISTANCE_DEG - 95, magnitudes)
        measured.append(float(zero_point / 1000 * 10 ** (-0.4 * magnitude) / _ARCSEC2_SR))
    scale, beyond = measured[-1] / float(np.interp(_I_NM, grid, scattered)), grid > _I_NM
    wavelengths = [*(wavelength for wavelength, *_ in _BANDS), *grid[beyond]]
    return Spectrum.of(wavelengths, [*measured, *(scale * scattered)[beyond]], _KNOWN_NM)


TWILIGHT = _twilight()
"""Radiance of the zenith, W·m⁻²·sr⁻¹·nm⁻¹."""


V_NM = 545.0
"""Effective wavelength of V (Bessell et al. 1998, A&A 333, 231)."""
S10 = 1.193e-11
"""Radiance at V, W·m⁻²·sr⁻¹·nm⁻¹: 27.78 mag·arcsec⁻² with 3.631e-8 W·m⁻²·µm⁻¹ at magnitude 0."""
STARS_S10, ZODIACAL_S10 = 105.0, 96.0


def _starlight() -> Spectrum:
    grid = np.array(WAVELENGTHS_NM)
    stars, zodiacal = planckian(4500.0), ABOVE_ATMOSPHERE(grid) * _reddening(grid)  # K, of stars
    at_v = float(ABOVE_ATMOSPHERE(V_NM) * _reddening(np.array(V_NM)))
    above = STARS_S10 * stars(grid) / float(stars(V_NM)) + ZODIACAL_S10 * zodiacal / at_v
    return Spectrum.of(WAVELENGTHS_NM, S10 * above * transmission())


def _reddening(wavelength_nm: Floats) -> Floats:
    return np.asarray(1 + 0.6 * np.log10(wavelength_nm / 500))


STARLIGHT = _starlight()
"""Mean radiance of the sky on the ground, W·m⁻²·sr⁻¹·nm⁻¹."""


_STEP_NM = 20.0
_SI = 1e-8
"""Factor from nW·cm⁻²·sr⁻¹·µm⁻¹ to W·m⁻²·sr⁻¹·nm⁻¹."""

# A mean holds between edges, except for 1 nm, as interpolation would move light out of bands.
_HALF_NM = _STEP_NM / 2 - 0.5
_INFRARED_NM = 890.0 + _STEP_NM * np.arange(len(TABLES["night"]))[:, None] + [-_HALF_NM, _HALF_NM]

MOONLESS_ZENITH = Spectrum.of(
    [*TABLES["night visible nm"], *_INFRARED_NM.ravel()],
    _SI * np.array([*TABLES["night visible"], *np.repeat(TABLES["night"], 2)]),
    _KNOWN_NM,
)
"""Radiance of the moonless zenith, away from the Milky Way, W·m⁻²·sr⁻¹·nm⁻¹."""

FAINT_STARLIGHT = STARLIGHT.scaled(75 * S10 / float(STARLIGHT(V_NM)))
"""Part of it from beyond the atmosphere, W·m⁻²·sr⁻¹·nm⁻¹."""

_NIGHT_NM = sorted({*MOONLESS_ZENITH.wavelengths_nm, *FAINT_STARLIGHT.wavelengths_nm})
AIRGLOW = Spectrum.of(
    _NIGHT_NM,
    MOONLESS_ZENITH(_NIGHT_NM) - FAINT_STARLIGHT(_NIGHT_NM),
    common_range([MOONLESS_ZENITH, FAINT_STARLIGHT]),
)
"""Radiance of airglow at the zenith, W·m⁻²·sr⁻¹·nm⁻¹."""


OPTICAL_THICKNESS = 30.0
_FORWARD = 0.86


def _color() -> Spectrum:
    absorbed = 0.85 * 100 * np.array(TABLES["water"]) * 8e-6  # m, droplets
    without = 1 / (1 + math.sqrt(3) * (1 - _FORWARD) / 2 * OPTICAL_THICKNESS)
    # Transmitted share of diffuse light, by the absorbed share 1 − ω.
    scattered = 1 - absorbed
    gamma = math.sqrt(3) * (2 - scattered * (1 + _FORWARD)) / 2
    k = np.sqrt(gamma**2 - (math.sqrt(3) * scattered * (1 - _FORWARD) / 2) ** 2)
    x = k * OPTICAL_THICKNESS
    through = k / (k * np.cosh(x) + gamma * np.sinh(x))
    return Spectrum.of(TABLES["water nm"], [1.0, *(through / without)[1:]])


OVERCAST = replace(_color(), known_nm=(100.0, TABLES["water nm"][-1]))
"""Transmission of a closed layer, relative to that in the visible."""


def overcast_share(cover: float) -> float:
    """Share of a clear sky's illuminance under clouds that cover a share of the sky (0 to 1).

    1 − 0.75·n^3.4, a mean over years (Kasten and Czeplak 1980, Solar Energy 24, 177); single skies
    differ by a factor of two.
    """
    return 1 - 0.75 * math.pow(cover, 3.4)
