"""Starlight and zodiacal light: what a moonless sky has of light from beyond the atmosphere.

Means over the whole sky above the atmosphere, in S10, stars of tenth magnitude in V per square
degree (27.78 mag·arcsec⁻²):

- all stars and what dust scatters of them: 105 (Roach and Gordon 1973, The Light of the Night Sky),
  taken to have the color of a black body of 4500 K;
- zodiacal light: 140 − 90·sin|β| up to an ecliptic latitude β of 60°, and 60 beyond (Benn and
  Ellison 1998, La Palma Technical Note 115), whose mean is 96; sunlight, reddened by
  1 + 0.6·lg(λ/500 nm) (Leinert et al. 1998, A&AS 127, 1, Eq. 22, at an elongation of 90°).

The atmosphere takes from both what it takes from sun and sky together. The Milky Way is three times
as bright as the mean, the pole of the ecliptic has 60; here it is the same everywhere.
"""

import numpy as np
from numpy.typing import NDArray

from megalopta.scenes.spectra.blackbody import planckian
from megalopta.scenes.spectra.spectrum import Spectrum
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


def _reddening(wavelength_nm: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(1 + 0.6 * np.log10(wavelength_nm / 500))


STARLIGHT = _starlight()
"""Mean radiance of the sky on the ground, W·m⁻²·sr⁻¹·nm⁻¹."""
