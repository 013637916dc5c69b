"""Moonlight: what the lunar disc reflects of sunlight, straight or scattered by the sky.

The disc's reflectance is the model of Kieffer and Stone (2005, AJ 129, 2887, Eq. 10 and Table 4) at
phases of 7° and 90°, without libration, relative to that at 550 nm: a waning moon is redder. The
atmosphere does to moonlight what it does to sunlight.

Check that was not put in: 200 mlux of a full moon then come with 890 µW/m² at 0.8 to 1.7 µm, where
up to 600 were measured on the ground, through an air of unknown humidity (Krieg 2021,
doi:10.1038/s41598-021-98060-2).
"""

import numpy as np

from megalopta.scenes.spectra.spectrum import Spectrum

_WAVELENGTHS_NM = (
    *(350.0, 405.0, 441.6, 486.9, 549.1, 665.1, 745.3, 774.8, 865.3, 928.4),
    *(1059.5, 1243.2, 1538.7, 1633.6, 1981.5),
)
# fmt: off
FULL_MOON = Spectrum(_WAVELENGTHS_NM, (
    0.600, 0.798, 0.800, 0.878, 0.998, 1.218, 1.237, 1.310, 1.371, 1.350,
    1.513, 1.606, 1.881, 1.904, 2.071,
))
"""Reflectance of the disc at a phase of 7°, 1 at 550 nm."""
QUARTER_MOON = Spectrum(_WAVELENGTHS_NM, (
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
