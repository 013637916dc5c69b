"""What a closed layer of cloud does to the color of light, and clouds to its amount.

Droplets of water hardly absorb below 1.2 µm. Beyond, light that finds its way through a thick layer
has met enough of them to lose much. Two streams of diffuse light, up and down (Meador and Weaver
1980, J. Atmos. Sci. 37, 630, quadrature): T = k/(k·cosh kτ + γ₁·sinh kτ), k² = γ₁² − γ₂²,
γ₁ = √3·(2 − ω·(1 + g))/2, γ₂ = √3·ω·(1 − g)/2. Droplets that are large against the wavelength
absorb 1 − ω = 0.85·α·r (Bohren and Barkstrom 1974), with the absorption α of water. A stratus:
τ = 30, r = 8 µm, g = 0.86; nothing comes back from the ground.

The absorption of water: Hale and Querry (1973, Appl. Opt. 12, 555) and, between their wavelengths,
Kou et al. (1993, Appl. Opt. 32, 3531), to two digits.
"""

import math

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.scenes.spectra.spectrum import TABLES, Spectrum

OPTICAL_THICKNESS = 30.0
_DROPLET_M = 8e-6
_FORWARD = 0.86


def _through(absorbed: Floats) -> Floats:
    """Share that the layer lets through of diffuse light, by the share 1 − ω absorbed."""
    scattered = 1 - absorbed
    gamma = math.sqrt(3) * (2 - scattered * (1 + _FORWARD)) / 2
    k = np.sqrt(gamma**2 - (math.sqrt(3) * scattered * (1 - _FORWARD) / 2) ** 2)
    x = k * OPTICAL_THICKNESS
    return np.asarray(k / (k * np.cosh(x) + gamma * np.sinh(x)))


def _color() -> Spectrum:
    absorbed = 0.85 * 100 * np.array(TABLES["water"]) * _DROPLET_M
    without = 1 / (1 + math.sqrt(3) * (1 - _FORWARD) / 2 * OPTICAL_THICKNESS)
    values = (_through(absorbed) / without).tolist()
    return Spectrum(TABLES["water nm"], (1.0, *values[1:]))


OVERCAST = _color()
"""Transmission of a closed layer, relative to that in the visible."""


def overcast_share(cover: float) -> float:
    """Share of a clear sky's illuminance under clouds that cover a share of the sky (0 to 1).

    1 − 0.75·n^3.4, a mean over years (Kasten and Czeplak 1980, Solar Energy 24, 177); single skies
    are off by a factor of two.
    """
    return 1 - 0.75 * math.pow(cover, 3.4)
