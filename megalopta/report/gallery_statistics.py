"""Statistics of views of forests beside those of photographs.

Every preset is seen in four directions by a camera of 75° and 0.3° per pixel. Beside photographed
panoramas all are seen at one coarser angle, so that a pixel is the mean of at least two by two of
a photograph's: statistics depend on the angle of a pixel, and what a photograph shows from pixel to
pixel is its lens and its stitching. Of each statistic stand the mean over the views and its
standard error. What a lens would do to the forests is shown by a Gaussian blur of their light.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator
from scipy.ndimage import gaussian_filter

from megalopta.config.model import Configuration
from megalopta.config.yaml_model import validated
from megalopta.core.arrays import Floats
from megalopta.core.progress import progress
from megalopta.flow.stimuli.statistics import PASSES, LogStatistics, log_statistics, unlit_share
from megalopta.plotting.picture import Cell, Figure, columns_of, write_figure
from megalopta.plotting.style import BLUE, ORANGE
from megalopta.render import SceneRenderer, frame_seed, read_picture
from megalopta.stages.render import build

PRESETS = "open", "clearing", "dense", "understorey", "rainforest", "trail"
SAMPLES = 36
"""Per pixel and pass"""

DIRECTIONS = 4
FINEST_DEG = 0.3
"""Angle of a pixel without photographs"""

BLUR_PX = 0.7
"""Standard deviation of a lens's blur"""

_FOV_DEG, _EYE_M = 75.0, 1.6
_STEP_DEG = 0.05
_TITLES = {
    "contrast": "standard deviation",
    "skewness": "skewness",
    "kurtosis": "kurtosis",
    "neighbor_correlation": "correlation",
    "gradient_contrast": "σ of differences",
    "gradient_kurtosis": "their kurtosis",
    "spectrum_slope": "exponent of power",
}
_ALIKE = 1.3
"""Factor within which a statistic is near that of a photograph"""


def write_statistics(
    out: Path,
    panoramas: Sequence[Path] = (),
    samples_per_pixel: int = SAMPLES,
    presets: Sequence[str] = PRESETS,
    side_px: int | None = None,
) -> list[Path]:
    """Render the views and write image-statistics.png, .svg, .csv and .json into a folder.

    Panoramas are photographs all around: HDR, EXR or PNG files, 2:1. Each of eight renderings of a
    view of 75° takes so many light paths per pixel; its side is by default that of 0.3° per pixel,
    or of two pixels of the coarsest photograph. Raises UserError, ValueError when there is no such
    panorama, or it cannot be read.
    """
    side_px = side_px or round(_FOV_DEG / degrees_per_px(panoramas))
    scenes = {each.stem: {"kind": "panorama", "file": str(each)} for each in panoramas}
    scenes |= {preset: {"kind": "forest", "preset": preset} for preset in presets}
    settings = {
        name: _settings(name, scene, samples_per_pixel, side_px) for name, scene in scenes.items()
    }
    found: dict[str, list[LogStatistics]] = {name: [] for name in scenes}
    found |= {f"{preset}, blurred": [] for preset in presets}
    unlit = 0.0
    with progress("Rendering views", len(scenes) * DIRECTIONS * PASSES, "picture") as advance:
        for name, each in settings.items():
            for passes in _views(each, advance):
                found[name].append(log_statistics(passes))
                if name in presets:
                    softer = [gaussian_filter(light, BLUR_PX) for light in passes]
                    found[f"{name}, blurred"].append(log_statistics(softer))
                    unlit = max(unlit, unlit_share(passes))
    out.mkdir(parents=True, exist_ok=True)
    return write_figure(_figure(found, len(panoramas), side_px, unlit), out)


def degrees_per_px(panoramas: Sequence[Path]) -> float:
    """Return the angle of a pixel at which forests and photographs are compared.

    Raises ValueError when a photograph cannot be read.
    """
    coarsest = max((360 / read_picture(str(each)).shape[1] for each in panoramas), default=0.0)
    return max(FINEST_DEG, _STEP_DEG * math.ceil(2 * coarsest / _STEP_DEG))


def _settings(
    name: str, scene: dict[str, str], samples_per_pixel: int, side_px: int
) -> Configuration:
    is_photograph = scene["kind"] == "panorama"
    sky = {} if is_photograph else {"sky": "natural", "disc_azimuth_deg": 150}
    values = {
        "scene": scene,
        "light": {"level": "daylight", **sky},
        "camera": {"width": side_px, "height": side_px, "fov_deg": _FOV_DEG},
        "trajectory": {
            "frames": DIRECTIONS,
            "position_m": [0, 0, _EYE_M],
            "look_at_m": [10, 0, _EYE_M],
            "frame_rate_hz": 1,
            "rotation_deg_s": 360 / DIRECTIONS,
        },
        "render": {
            "samples_per_pixel": samples_per_pixel,
            "integrator": "path",
            "bands_nm": [[507, 614]],
        },
    }
    return validated(Configuration, values, name)


def _views(settings: Configuration, advance: Callable[[int], None]) -> Iterator[list[Floats]]:
    """Yield the independent renderings of each view, (H, W) each."""
    renderer = SceneRenderer(build(settings), settings.camera, settings.render)
    for index, pose in enumerate(settings.trajectory.poses()):
        passes = []
        for number in range(PASSES):
            light = renderer.radiance(pose, frame_seed(settings.seed, index, number))[..., 0]
            passes.append(light.astype(float))
            advance(1)
        yield passes


def _figure(
    found: dict[str, list[LogStatistics]], photographs: int, side_px: int, unlit: float
) -> Figure:
    rows = [_row(name, each) for name, each in found.items()]
    shaded = f"; shaded, within a factor of {_ALIKE:g} of a photograph" if photographs else ""
    return Figure(
        name="image-statistics",
        title="Statistics of the logarithm of light in views of forests",
        caption=(
            f"Mean and standard error over {DIRECTIONS} views of {_FOV_DEG:g}° at "
            f"{_FOV_DEG / side_px:.3g}° per pixel from {_EYE_M:g} m, in daylight{shaded} (of the "
            "correlation, its distance from 1); blurred, by "
            f"{BLUR_PX:g} px as a lens does. Differences and correlation are those of neighbors "
            "along rows, the exponent that of the power over the radial frequency. Noise is taken "
            f"out by products of {PASSES} renderings, of whose pixels at most "
            f"{100 * unlit:.2g} % met no light."
        ),
        draw=partial(_draw, rows=rows, photographs=photographs),
        numbers=columns_of(rows),
        height_in=1.6 + 0.44 * len(rows),
    )


def _row(name: str, views: Sequence[LogStatistics]) -> dict[str, Cell]:
    row: dict[str, Cell] = {"scene": name}
    for field in fields(LogStatistics):
        values = np.array([getattr(each, field.name) for each in views])
        row[field.name] = float(values.mean())
        row[f"{field.name}_error"] = float(values.std(ddof=1) / len(values) ** 0.5)
    return row


def _draw(canvas: Canvas, rows: Sequence[dict[str, Any]], photographs: int) -> None:
    """Draw a panel for each statistic, a line for each scene."""
    panels = canvas.subplots(2, 4, sharey=True).ravel()
    panels[-1].set_axis_off()
    for axes, (name, title) in zip(panels, _TITLES.items(), strict=False):
        base = 1 if name == "neighbor_correlation" else 0
        for place, row in enumerate(rows):
            color = ORANGE if place < photographs else BLUE
            axes.errorbar(row[name], place, xerr=row[f"{name}_error"], fmt="o", color=color)
            if place < photographs:
                alike = (base + (row[name] - base) * factor for factor in (1 / _ALIKE, _ALIKE))
                axes.axvspan(*alike, color=color, alpha=0.15, linewidth=0)
        axes.set_title(title, fontsize=10)
        axes.set_yticks(range(len(rows)), [row["scene"] for row in rows])
        axes.xaxis.set_major_locator(MaxNLocator(3))
    panels[0].set_ylim(len(rows) - 0.5, -0.5)
