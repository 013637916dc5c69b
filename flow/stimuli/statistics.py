"""Statistics of a template that determine the photons that motion detectors need.

A template (rows, columns) is a full turn: periodic in columns, not in rows. Natural scenes
have power spectra that fall about as the square of frequency, and gradients with far heavier tails
than a normal distribution (Ruderman and Bialek, Phys. Rev. Lett. 73, 814, 1994; Simoncelli and
Olshausen, Annu. Rev. Neurosci. 24, 1193, 2001).

**Logarithms** are independent of exposure. Ratios of light characterize surfaces, and the logarithm
of natural scenes has much in common from scene to scene (Ruderman and Bialek, ibid.; Huang and
Mumford, CVPR 1999).

A rendering has noise, which looks like texture. Of independent renderings of one view, products of
values from different ones have that of the view itself as their mean: moments are made of those, a
variance of two of them, a fourth moment of four. The logarithm of a noisy value is too small on
average, by half of its relative variance to first order, and most in the shade, where paths of
light vary most. So two renderings a and b give one value, 2·log((a + b)/2) − (log a + log b)/2,
without that order (the jackknife: Quenouille, Biometrika 43, 353, 1956). A photograph replaces all
renderings.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from megalopta.core.arrays import Floats

FLAT_GRADIENT = 0.01
"""Neighbors along a row that differ by less than this share of the mean count as flat."""

_FIT_CYCLES_PER_PX = (0.02, 0.3)
_RINGS = 24

PASSES = 8
"""Independent renderings: two for each of the four values of a fourth moment"""

_DARKEST = 1e-4
"""Share of the mean light below which a pixel counts as this, since no path of light reached it"""


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
        spectrum_slope=_slope(*power_spectrum(template)),
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


@dataclass(frozen=True)
class LogStatistics:
    """Statistics of the natural logarithm of light."""

    contrast: float
    """Standard deviation"""
    skewness: float
    kurtosis: float
    """Fourth moment over the squared second; 3 for a normal distribution"""
    gradient_contrast: float
    """RMS of differences of neighbors along rows"""
    gradient_kurtosis: float
    """Kurtosis of these differences; 3 for a normal distribution"""
    neighbor_correlation: float
    """Correlation of neighbors along rows"""
    spectrum_slope: float
    """Exponent of the power over the radial frequency, 0.02 to 0.3 cycles/px"""


def log_statistics(passes: Sequence[Floats]) -> LogStatistics:
    """Return the statistics of a view from eight independent renderings (H, W) of it.

    A picture without noise is given eight times.

    Raises ValueError if there are not eight, of one shape, of finite light above 0 in total.
    """
    light = np.asarray(passes, np.float64)
    if light.ndim != 3 or len(light) != PASSES or not np.isfinite(light).all() or light.min() < 0:
        raise ValueError(f"passes of shape {light.shape}: give {PASSES} (H, W) of light, 0 or more")
    if not light.any(axis=(1, 2)).all():
        raise ValueError("a pass is black, without logarithm; give passes with light")
    darkest = _DARKEST * light.mean()
    one, other = light[::2], light[1::2]
    noisy = (np.log(np.maximum(one, darkest)) + np.log(np.maximum(other, darkest))) / 2
    logs = 2 * np.log(np.maximum((one + other) / 2, darkest)) - noisy
    logs -= logs.mean(axis=(1, 2), keepdims=True)
    steps = np.diff(logs, axis=2)
    variance, of_step = _moment(logs, 2), _moment(steps, 2)
    # (a − b)² of neighbors is twice the variance minus twice their product
    beside = (_moment(logs[..., :-1], 2) + _moment(logs[..., 1:], 2)) / 2
    return LogStatistics(
        contrast=variance**0.5,
        skewness=_moment(logs, 3) / variance**1.5,
        kurtosis=_moment(logs, 4) / variance**2,
        gradient_contrast=of_step**0.5,
        gradient_kurtosis=_moment(steps, 4) / of_step**2,
        neighbor_correlation=1 - of_step / (2 * beside),
        spectrum_slope=_slope(*_log_spectrum(logs)),
    )


def unlit_share(passes: Sequence[Floats]) -> float:
    """Return the share of the pixels of renderings (n, H, W) that no path of light reached."""
    light = np.asarray(passes)
    return float(np.mean(light < _DARKEST * light.mean()))


def _moment(values: Floats, order: int) -> float:
    """Mean product of `order` different passes, over all ways to choose them."""
    chosen = combinations(values, order)
    return float(np.mean([np.mean(np.prod(each, axis=0)) for each in chosen]))


def _log_spectrum(logs: Floats) -> tuple[Floats, Floats]:
    """Return radial frequencies and mean products of different passes, as `ring_means`."""
    rows, columns = logs.shape[1:]
    window = np.outer(np.hanning(rows + 2)[1:-1], np.hanning(columns + 2)[1:-1])
    spectra = np.fft.rfft2(logs * window)
    pairs = [(a * b.conj()).real for a, b in combinations(spectra, 2)]
    return ring_means(np.mean(pairs, axis=0), columns)


def _slope(frequency: Floats, power: Floats) -> float:
    lower, upper = _FIT_CYCLES_PER_PX
    fitted = (frequency >= lower) & (frequency <= upper) & (power > 0)
    return float(np.polyfit(np.log(frequency[fitted]), np.log(power[fitted]), 1)[0])
