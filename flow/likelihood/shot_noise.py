"""How much to smooth counts before aligning them, and what shot noise that leaves in their roots.

Where a texture of power spectrum S meets shot noise of variance N (the mean count), the most
likely shift between two frames is that of greatest correlation after a filter S/(S + N/2); over n
frames that agree, after S/(S + N/n). Both pass what is stronger than the noise. Natural textures
have edges, so S falls about as f⁻³ from a height that the excess of the counts' variance over
their mean measures. With

    q = (variance − mean)/mean          (index of dispersion − 1: texture over shot noise)

S/N goes as q·f⁻³, the cutoff as (n·q)^(1/3), and the width of the filter in pixels as its inverse.
Its shape hardly matters, so it is a Gaussian. Its constant was fitted on dead leaves and on one
photographed forest at 10⁴ to 10⁶ photons per frame of 240 × 240 px; the best width is so broad an
optimum that a step of √2 changes errors by a few percent.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats

_BLUR_AT_EQUALITY_PX = 0.6
"""Best standard deviation for two frames with as much texture as shot noise, q = 1"""

_FAINTEST = 1e-6
"""Smaller q are raised to this: no texture was seen, the widest blur is right."""


def suited_blur_px(excess: Floats, frames: int) -> Floats:
    """Return the standard deviation of the best blur (px), of any shape.

    Parameters
    ----------
    excess
        q, of the unsmoothed counts.
    frames : int
        How many frames are to agree.
    """
    ratios = np.maximum(excess, _FAINTEST) * frames / 2
    return np.asarray(_BLUR_AT_EQUALITY_PX * ratios ** (-1 / 3))


def root_noise(smooth: Callable[[Floats], NDArray[Any]]) -> float:
    """Return the variance that shot noise gives to the roots of smoothed counts, at any brightness.

    A quarter of what smoothing leaves of a variance equal to the mean.

    Parameters
    ----------
    smooth
        (H, W) to the same; reaches 15 px at most.
    """
    impulse = np.zeros((31, 31))
    impulse[15, 15] = 1
    return float((smooth(impulse) ** 2).sum() / 4)
