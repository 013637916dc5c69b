"""Mean responses of NDM and NDS to a moving sinusoid, in closed form (thesis, Eqs. 4.2 and 4.3).

The stimulus is ½(1 + C sin(ωt + jφ)): ω radians per frame, φ radians per pixel. One that moves by
v pixels per frame has ω = φ·v. Eq. 4.3 is misprinted; here it is corrected. The output low-pass
of a detector changes no mean.
"""

import numpy as np
from numpy.typing import ArrayLike

from megalopta.flow.detectors.base import FloatArray


def ndm_mean(filter_step: float, omega: ArrayLike, phase: float, contrast: float) -> FloatArray:
    """Return the mean response of NDM before rectification, (C²/4)·h1²·h2·cos φ2·cos φ (Eq. 4.2).

    Parameters
    ----------
    filter_step : float
        Step a of the high-pass and of the delay, 0 < a < 1.
    omega : array_like of any shape
        Temporal frequency, rad per frame.
    phase : float
        Spatial frequency φ, rad per pixel.
    contrast : float
        Michelson contrast C.
    """
    high_pass, delayed = _gains(filter_step, omega)
    return np.asarray(contrast**2 / 4 * high_pass**2 * delayed.real * np.cos(phase))


def nds_mean(filter_step: float, omega: ArrayLike, phase: float, contrast: float) -> FloatArray:
    """Return the mean response of NDS, rectified: 2A/π, A = (C/2)·h1·|1 + 2·Hl·cos φ|.

    Parameters and shape as for `ndm_mean`.
    """
    high_pass, delayed = _gains(filter_step, omega)
    amplitude = contrast / 2 * high_pass * np.abs(1 + 2 * delayed * np.cos(phase))
    return np.asarray(2 / np.pi * amplitude)


def _gains(step: float, omega: ArrayLike) -> tuple[FloatArray, np.ndarray]:
    """Amplitude h1 of the high-pass and complex gain Hl of the delay."""
    z = np.exp(-1j * np.asarray(omega, dtype=float))
    rest = 1 - (1 - step) * z
    return np.abs((1 - step) * (1 - z) / rest), step / rest
