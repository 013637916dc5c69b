"""Moonlight: sunlight, reddened by the lunar surface.

A black body of 5778 K times the reflectance of the disc, which is taken to grow linearly with
wavelength, by 0.86 of its value at 550 nm per µm. That is the best such line through the full moon
of Kieffer and Stone (2005, AJ 129, 2887), their model of the disc at a phase of 7°, from 0.41 to
2 µm; it is off by up to 0.14. A quarter moon is redder (1.39 per µm), by a fifth at 1.6 µm.

The atmosphere is left out, and with it the bands of water vapor: 200 mlux of this light come with
1050 µW/m² at 0.8 to 1.7 µm, where up to 600 were measured on the ground (Krieg 2021,
doi:10.1038/s41598-021-98060-2).
"""

import numpy as np

from megalopta.scenes.spectra.blackbody import planckian
from megalopta.scenes.spectra.spectrum import Spectrum

SUN_K = 5778.0
REDDENING_PER_UM = 0.86


def _reddened(light: Spectrum) -> Spectrum:
    from_green_um = (np.array(light.wavelengths_nm) - 550) / 1000
    values = np.array(light.values) * (1 + REDDENING_PER_UM * from_green_um)
    return Spectrum(light.wavelengths_nm, tuple(map(float, values)))


MOONLIGHT = _reddened(planckian(SUN_K))
"""Relative spectrum, 300 to 2000 nm."""
