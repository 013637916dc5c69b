"""Twilight: the sky's zenith with the sun 6.4° below the horizon, when the ground gets 1 lux.

Magnitudes in U, B, V, R and I are the fits of Patat, Ugolnikov and Postylyakov (2006, A&A 455, 385,
Table 1) to the zenith over Paranal, with the wavelengths and zero points of Bessell et al. (1998,
A&A 333, 231): a sky of that brightness gives 1.0 lux. Beyond I it is sunlight on the ground times
λ⁻⁴, the scattering of air. So it meets airglow where that was seen to happen: at a depression of
9.3° in J and 7.4° in H (Dome A, arXiv:2607.01923). The broad bands hide what ozone takes at 600 nm.

Where the sun went down the sky is several times as bright; here it is the same everywhere.
"""

import math

import numpy as np

from megalopta.scenes.spectra.spectrum import Spectrum
from megalopta.scenes.spectra.sunlight import ABOVE_ATMOSPHERE, WAVELENGTHS_NM, transmission

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
