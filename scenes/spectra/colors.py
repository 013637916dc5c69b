"""Reflectances of surfaces of which a color is known.

A color in linear sRGB says little about a spectrum. Here the reflectance is a sum of those of red,
green and blue, which add up to 1 (Mallett and Yuksel 2019, Spectral Primary Decomposition for
Rendering with sRGB Reflectance). They are the smoothest that are nowhere negative and have, in D65,
the colors of sRGB. Sums are linear in the color, so that a texture of colors is one of three
weights. Beyond 360 to 830 nm a color says nothing.
"""

import numpy as np
from numpy.typing import ArrayLike

from megalopta.scenes.spectra.spectrum import TABLES, Spectrum

KNOWN_NM = (360.0, 830.0)
"""Lowest and highest wavelength at which a color has a reflectance."""
_RED, _BLUE = (np.array(TABLES[f"{name} of sRGB"]) for name in ("red", "blue"))
_GRID_NM = np.linspace(*KNOWN_NM, len(_RED))
_OF_PRIMARIES = np.stack([_RED, (1 - _RED - _BLUE).clip(0), _BLUE])


def reflectance_of_color(rgb: ArrayLike) -> Spectrum:
    """Return the reflectance of a color (3,) in linear sRGB, 0 to 1."""
    return Spectrum.of(_GRID_NM, np.asarray(rgb, np.float64) @ _OF_PRIMARIES)


RED, GREEN, BLUE = map(reflectance_of_color, np.eye(3))
"""Reflectances of the primaries of sRGB."""
