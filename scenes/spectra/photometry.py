"""Photometry: the eye's luminous efficiency V(λ) and what follows from it.

V(λ) is the CIE 1924 photopic curve at steps of 10 nm, linear between; its integral is 106.86 nm, so
a flat spectrum of luminance L_v has L_λ = L_v / (683 · 106.86).
"""

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.scenes.spectra.spectrum import TABLES, Spectrum

MAXIMUM_EFFICACY_LM_W = 683.0

_V_FIRST_NM = 380.0
_V_STEP_NM = 10.0
_V = TABLES["luminous efficiency"]


def luminous_efficiency(wavelength_nm: Floats) -> Floats:
    """CIE 1924 photopic luminous efficiency V(λ), 0 outside 380 to 770 nm; of any shape."""
    table_nm = _V_FIRST_NM + _V_STEP_NM * np.arange(len(_V))
    return np.interp(wavelength_nm, table_nm, _V, left=0.0, right=0.0)


def luminous(spectrum: Spectrum) -> float:
    """Photometric value of a spectral quantity: 683 lm/W · ∫ S(λ)·V(λ) dλ.

    Irradiance in W·m⁻²·nm⁻¹ gives lux, radiance in W·m⁻²·sr⁻¹·nm⁻¹ gives cd/m². By the trapezoidal
    rule in steps of 1 nm, which is exact to 1e-4 for spectra without narrow lines.
    """
    grid = np.arange(_V_FIRST_NM, _V_FIRST_NM + _V_STEP_NM * len(_V))
    return float(
        MAXIMUM_EFFICACY_LM_W * np.trapezoid(spectrum(grid) * luminous_efficiency(grid), grid)
    )
