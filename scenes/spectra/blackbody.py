"""The spectrum of a black body."""

import numpy as np
from scipy.constants import c, h, k

from megalopta.scenes.spectra.spectrum import Spectrum


def planckian(temperature_k: float) -> Spectrum:
    """Relative spectrum of a black body at 300 to 2000 nm, largest value 1 (Planck's law)."""
    wavelengths_nm = np.concatenate([np.arange(300, 800, 10), np.arange(800, 2001, 50)])
    meters = wavelengths_nm * 1e-9
    values = meters**-5 / np.expm1(h * c / (meters * k * temperature_k))
    values /= values.max()
    return Spectrum(tuple(map(float, wavelengths_nm)), tuple(map(float, values)))
