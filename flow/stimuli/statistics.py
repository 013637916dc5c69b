"""Power spectra of images.

Those of natural scenes fall about as the square of frequency (Ruderman and Bialek, Phys. Rev. Lett.
73, 814, 1994).
"""

import numpy as np

from megalopta.core.arrays import Floats

_FIT_CYCLES_PER_PX = (0.02, 0.3)
_RINGS = 24


def ring_means(power: Floats, columns: int) -> tuple[Floats, Floats]:
    """Radial frequencies (cycles/px), (N,), and means over their rings.

    `power` is (H, W//2 + 1) in the order of `numpy.fft.rfft2` of an image of `columns` columns.
    """
    rows = len(power)
    radius = np.hypot(np.fft.fftfreq(rows)[:, np.newaxis], np.fft.rfftfreq(columns))
    edges = np.geomspace(2 / min(rows, columns), 0.5, _RINGS + 1)
    ring = np.digitize(radius.ravel(), edges) - 1
    inside = (ring >= 0) & (ring < _RINGS)
    count = np.bincount(ring[inside], minlength=_RINGS)
    power_sum = np.bincount(ring[inside], power.ravel()[inside], _RINGS)
    radius_sum = np.bincount(ring[inside], radius.ravel()[inside], _RINGS)
    filled = count > 0
    return radius_sum[filled] / count[filled], power_sum[filled] / count[filled]


def fitted_slope(frequency: Floats, power: Floats) -> float:
    """Return the exponent of a power over frequencies from 0.02 to 0.3 cycles/px."""
    lower, upper = _FIT_CYCLES_PER_PX
    fitted = (frequency >= lower) & (frequency <= upper) & (power > 0)
    return float(np.polyfit(np.log(frequency[fitted]), np.log(power[fitted]), 1)[0])
