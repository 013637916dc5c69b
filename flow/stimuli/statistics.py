"""Statistics of a template that determine the photons that motion detectors need.

A template (rows, columns) is a full turn: periodic in columns, not in rows. Natural scenes
have power spectra that fall about as the square of frequency, and gradients with far heavier tails
than a normal distribution (Ruderman and Bialek, Phys. Rev. Lett. 73, 814, 1994; Simoncelli and
Olshausen, Annu. Rev. Neurosci. 24, 1193, 2001).
"""

from dataclasses import dataclass

import numpy as np

from megalopta.core.arrays import Floats

FLAT_GRADIENT = 0.01
"""Neighbors along a row that differ by less than this share of the mean count as flat."""

_FIT_CYCLES_PER_PX = (0.02, 0.3)
_RINGS = 24


@dataclass(frozen=True)
class ImageStatistics:
    """Statistics of a template."""

    contrast: float
    """Standard deviation over the mean"""
    spectrum_slope: float
    """Exponent of the power spectrum over the radial frequency, 0.02 to 0.3 cycles/px"""
    gradient_kurtosis: float
    """Fourth moment over the squared second of differences along rows; 3 if normal"""
    gradient_contrast: float
    """RMS of those differences over the mean"""
    flat_share: float
    """Share of those differences below 1 % of the mean: a detector's response there is near zero,
    and so is the denominator of a relative error"""


def image_statistics(template: Floats) -> ImageStatistics:
    """Statistics of a template (rows, columns), a full turn."""
    relative = template / template.mean()
    gradient = np.diff(relative, axis=1, append=relative[:, :1])
    return ImageStatistics(
        contrast=float(relative.std()),
        spectrum_slope=fitted_slope(*power_spectrum(template)),
        gradient_kurtosis=float(np.mean(gradient**4) / np.mean(gradient**2) ** 2),  # of mean 0
        gradient_contrast=float(np.sqrt(np.mean(gradient**2))),
        flat_share=float(np.mean(np.abs(gradient) < FLAT_GRADIENT)),
    )


def power_spectrum(template: Floats) -> tuple[Floats, Floats]:
    """Radial frequencies (cycles/px), (N,), and mean power over their rings, of mean 1.

    Rows have a Hann window; columns are periodic.
    """
    rows, columns = template.shape
    window = np.hanning(rows + 2)[1:-1, np.newaxis]
    centered = template / template.mean() - 1
    power = np.abs(np.fft.rfft2(centered * window)) ** 2 / (columns * np.sum(window**2))
    return ring_means(power, columns)


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
