"""Spectra of the three colors of a picture whose white is a given light.

Three colors say little about a spectrum. Here each pixel has the light's spectrum times a smooth
function of wavelength: red, green and blue take one another's place in logistic steps, so that
white has the light's spectrum, nothing is negative, and no light is lost or gained. The steps lie
where each color has the share in the luminance that sRGB gives it. Beyond the visible red goes on
to the infrared and blue to the ultraviolet, of which the picture knows nothing.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import expit

from megalopta.scenes.spectra.photometry import luminous
from megalopta.scenes.spectra.spectrum import Spectrum

LUMINANCE_SHARES = (0.2126, 0.7152, 0.0722)
"""Of red, green and blue in linear sRGB (IEC 61966-2-1)."""

_STEP_WIDTH_NM = 12.0
_GRID_NM = np.concatenate([np.arange(300.0, 800.0, 5.0), np.arange(800.0, 2001.0, 10.0)])


def primaries(light: Spectrum) -> tuple[Spectrum, Spectrum, Spectrum]:
    """Spectra of red, green and blue that add up to that of white, with sRGB's luminances."""
    red_share, _, blue_share = LUMINANCE_SHARES
    values = light(_GRID_NM)
    total = luminous(_spectrum(values))

    def luminance_below(edge_nm: float) -> float:
        return luminous(_spectrum(values * expit((edge_nm - _GRID_NM) / _STEP_WIDTH_NM))) / total

    blue_edge = brentq(lambda edge: luminance_below(edge) - blue_share, 400.0, 700.0)
    red_edge = brentq(lambda edge: luminance_below(edge) - 1 + red_share, 400.0, 700.0)
    not_blue, red = (expit((_GRID_NM - edge) / _STEP_WIDTH_NM) for edge in (blue_edge, red_edge))
    green, blue = not_blue - red, 1 - not_blue
    return _spectrum(values * red), _spectrum(values * green), _spectrum(values * blue)


def _spectrum(values: NDArray[np.float64]) -> Spectrum:
    return Spectrum(tuple(_GRID_NM.tolist()), tuple(values.tolist()))
