"""The moonless night sky: starlight, zodiacal light and airglow.

Means over the whole sky above the atmosphere, in S10, stars of tenth magnitude in V per square
degree (27.78 mag·arcsec⁻²):

- all stars and what dust scatters of them: 105 (Roach and Gordon 1973, The Light of the Night Sky),
  taken to have the color of a black body of 4500 K;
- zodiacal light: 140 − 90·sin|β| up to an ecliptic latitude β of 60°, and 60 beyond (Benn and
  Ellison 1998, La Palma Technical Note 115), whose mean is 96; sunlight, reddened by
  1 + 0.6·lg(λ/500 nm) (Leinert et al. 1998, A&AS 127, 1, Eq. 22, at an elongation of 90°).

The atmosphere takes from both what it takes from sun and sky together. The Milky Way is three times
as bright as the mean, the pole of the ecliptic has 60; here it is the same everywhere.

The moonless night sky, 0.37 to 1.8 µm, in absolute units, and what of it is airglow. On a moonless
night most of the short-wave infrared comes from hydroxyl some 87 km up (the Meinel bands) and from
molecular oxygen (1.27 µm). From 0.89 µm on the table is the radiance of the zenith seen from the
ground, in means over 20 nm, put together from published figures:

- shape of the hydroxyl bands: the line list of Rousselot et al. (2000, A&A 354, 1134), its
  intensities taken as photon rates and summed over 20 nm;
- between the lines, 590 photons·s⁻¹·m⁻²·arcsec⁻²·µm⁻¹ at all wavelengths (Maihara et al. 1993, PASP
  105, 940, measured at 1.665 µm);
- height: the sky over Paranal has 14.4 mag·arcsec⁻² in H (Cuby et al. 2000), with the zero point of
  1.133e-9 W·m⁻²·µm⁻¹ (Cohen et al. 2003), as the mean over 1.51 to 1.79 µm;
- oxygen: what is then missing at 1.17 to 1.33 µm from 16.5 mag·arcsec⁻² in J (same sources,
  3.129e-9 W·m⁻²·µm⁻¹), all of it at 1.26 to 1.28 µm. It comes to 11 kilorayleigh.

Below, where stars and zodiacal light have a part, it is five broad bands: 22.3, 22.6,
21.6, 20.9 and 19.7 mag·arcsec⁻² in U, B, V, R and I, the mean over Paranal (Patat 2003, A&A 400,
1183), at the effective wavelengths and zero points of Bessell et al. (1998, A&A 333, 231). That
makes 0.8 mlux, and 117 µW/m² at 0.9 to 1.7 µm, on a horizontal plane.

Checks that were not put in: the OH(4-2) band then has 78 kilorayleigh, and 80 is usual; between
lines, at 1.1913 µm, 4.5e-9 W·m⁻²·sr⁻¹·nm⁻¹ were measured (Nguyen et al. 2016, arXiv:1510.07567),
where the 590 photons make 4.2e-9.

Airglow is what is left of it without 75 S10 of zodiacal light and scattered starlight (Benn and
Ellison 1998, La Palma Technical Note 115; bright stars and the Milky Way were avoided). That is 220
S10 at V, where they give 145 to 270, from the least to the most active sun; the table was measured
near the most.

How far to trust it: a mean over 100 nm or more is good to some 20 % for a usual sky, as far as its
sources agree; a single value of the table is not, for lines fall to one side or the other of an
edge. Real airglow changes by a factor of two within a night, grows toward the horizon by up to a
factor of six (van Rhijn) and has moving waves; here it is the same everywhere. Beyond its ends the
table is constant and means nothing.
"""

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.scenes.spectra.spectrum import TABLES, Spectrum, planckian
from megalopta.scenes.spectra.sunlight import ABOVE_ATMOSPHERE, WAVELENGTHS_NM, transmission

V_NM = 545.0
"""Effective wavelength of V (Bessell et al. 1998, A&A 333, 231)."""
S10 = 1.193e-11
"""Radiance at V, W·m⁻²·sr⁻¹·nm⁻¹: 27.78 mag·arcsec⁻² with 3.631e-8 W·m⁻²·µm⁻¹ at magnitude 0."""
STARS_S10, ZODIACAL_S10 = 105.0, 96.0
_STAR_K = 4500.0


def _starlight() -> Spectrum:
    grid = np.array(WAVELENGTHS_NM)
    stars, zodiacal = planckian(_STAR_K), ABOVE_ATMOSPHERE(grid) * _reddening(grid)
    at_v = float(ABOVE_ATMOSPHERE(V_NM) * _reddening(np.array(V_NM)))
    above = STARS_S10 * stars(grid) / float(stars(V_NM)) + ZODIACAL_S10 * zodiacal / at_v
    return Spectrum(WAVELENGTHS_NM, tuple(map(float, S10 * above * transmission())))


def _reddening(wavelength_nm: Floats) -> Floats:
    return np.asarray(1 + 0.6 * np.log10(wavelength_nm / 500))


STARLIGHT = _starlight()
"""Mean radiance of the sky on the ground, W·m⁻²·sr⁻¹·nm⁻¹."""


# nm, nW·cm⁻²·sr⁻¹·µm⁻¹
_VISIBLE = ((366.0, 0.214), (438.0, 0.245), (545.0, 0.354), (641.0, 0.404), (798.0, 0.632))
_FIRST_NM = 890.0
_STEP_NM = 20.0
_SI = 1e-8
"""From nW·cm⁻²·sr⁻¹·µm⁻¹ to W·m⁻²·sr⁻¹·nm⁻¹."""

# A mean holds from edge to edge, but for 1 nm: linear between middles, light would leave bands.
_HALF_NM = _STEP_NM / 2 - 0.5
_INFRARED = tuple(
    (_FIRST_NM + _STEP_NM * step + side, value)
    for step, value in enumerate(TABLES["night"])
    for side in (-_HALF_NM, _HALF_NM)
)

MOONLESS_ZENITH = Spectrum(
    tuple(wavelength for wavelength, _ in _VISIBLE + _INFRARED),
    tuple(_SI * value for _, value in _VISIBLE + _INFRARED),
)
"""Radiance of the moonless zenith, away from the Milky Way, W·m⁻²·sr⁻¹·nm⁻¹."""

FAINT_STARLIGHT = STARLIGHT.scaled(75 * S10 / float(STARLIGHT(V_NM)))
"""What of it comes from beyond the atmosphere, W·m⁻²·sr⁻¹·nm⁻¹."""

_GRID_NM = sorted({*MOONLESS_ZENITH.wavelengths_nm, *FAINT_STARLIGHT.wavelengths_nm})
AIRGLOW = Spectrum(
    tuple(_GRID_NM),
    tuple((MOONLESS_ZENITH(_GRID_NM) - FAINT_STARLIGHT(_GRID_NM)).tolist()),
)
"""Radiance of airglow at the zenith, W·m⁻²·sr⁻¹·nm⁻¹."""
