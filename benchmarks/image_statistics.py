"""Print statistics of log radiance in views of the forests, and of photographed panoramas.

    python benchmarks/image_statistics.py [forest.hdr …]

Four views of 75° from 1.6 m, in daylight: mean and standard error. A pixel sees 0.3°, or two pixels
of the coarsest photograph. It takes an hour on two cores.

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

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import combinations
from pathlib import Path

import numpy as np
from bench_looks import fitted_slope, ring_means
from scipy.ndimage import gaussian_filter

from megalopta.config.model import Configuration
from megalopta.core.arrays import Floats
from megalopta.render import SceneRenderer, frame_seed, read_picture
from megalopta.stages.render import build

PASSES = 8
"""Independent renderings: two for each of the four values of a fourth moment"""

_DARKEST = 1e-4
"""Share of the mean light below which a pixel counts as this, since no path of light reached it"""


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
        spectrum_slope=fitted_slope(*_log_spectrum(logs)),
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


FOV_DEG, DIRECTIONS, BLUR_PX, SAMPLES = 75.0, 4, 0.7, 64
coarsest = max((360 / read_picture(name).shape[1] for name in sys.argv[1:]), default=0.0)
side_px = round(FOV_DEG / max(0.3, 0.05 * math.ceil(2 * coarsest / 0.05)))
photographs = {Path(name).stem: {"kind": "panorama", "file": name} for name in sys.argv[1:]}
presets = "open", "clearing", "dense", "understorey", "rainforest", "trail"
forests = {name: {"kind": "forest", "preset": name} for name in presets}
for name, scene in {**photographs, **forests}.items():
    sky = {"sky": "natural", "disc_azimuth_deg": 150} if name in forests else {}
    parts = {
        "scene": scene,
        "light": {"level": "daylight", **sky},
        "camera": {"width": side_px, "height": side_px, "fov_deg": FOV_DEG},
        "trajectory": {"frames": DIRECTIONS, "frame_rate_hz": 1, "rotation_deg_s": 360 / DIRECTIONS,
                       "position_m": [0, 0, 1.6], "look_at_m": [10, 0, 1.6]},
        "render": {"samples_per_pixel": SAMPLES, "integrator": "path", "bands_nm": [[507, 614]]},
    }  # fmt: skip
    settings = Configuration.model_validate(parts)
    renderer = SceneRenderer(build(settings), settings.camera, settings.render)
    found: dict[str, list[LogStatistics]] = {"as rendered": [], "blurred": []}
    for frame, pose in enumerate(settings.trajectory.poses()):
        seeds = [frame_seed(0, frame, repeat) for repeat in range(PASSES)]
        light = [renderer.radiance(pose, seed)[..., 0].astype(float) for seed in seeds]
        found["as rendered"].append(log_statistics(light))
        found["blurred"].append(log_statistics([gaussian_filter(one, BLUR_PX) for one in light]))
        print(f"{name}, view {frame}: {unlit_share(light):.2%} of the pixels met no light")
    for how, views in found.items():
        for field in fields(LogStatistics):
            values = np.array([getattr(each, field.name) for each in views])
            error = values.std(ddof=1) / DIRECTIONS**0.5
            print(f"{name}, {how}: {field.name} {values.mean():.3g} ± {error:.1g}")
