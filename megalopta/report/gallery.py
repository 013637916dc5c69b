"""`megalopta gallery`: scene presets at every light level, larger forest views, and statistics.

A scene is built once and rendered twice, with and without a disc in the sky, since their shadows
differ; the levels of each kind differ by a factor in every band. A view is denoised, and exposed
for its own light, which no eye and no camera can do at night. Below it are the counts of a sensor
without noise but that of photons, drawn from the light as rendered. A photographed panorama adds
two of the larger views: the photograph through the same camera, and a forest in its light.

For statistics every preset is seen in four directions by a camera of 75° and 0.3° per pixel. With
photographed panoramas, all are seen at one coarser angle, so that a pixel is the mean of at least
two by two of a photograph's: statistics depend on the angle of a pixel, and the finest detail of a
photograph is its lens and its stitching. A Gaussian blur of the forests' light shows the effect of
a lens.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import gaussian_filter

from megalopta.config.light_scale import light_scale
from megalopta.config.model import Configuration
from megalopta.config.yaml_model import validated
from megalopta.core import strict_yaml
from megalopta.core.arrays import Floats
from megalopta.core.progress import Advance, progress
from megalopta.core.validation import merged
from megalopta.flow.stimuli.statistics import PASSES, LogStatistics, log_statistics, unlit_share
from megalopta.plotting.picture import Cell, Figure, columns_of, write_figure
from megalopta.plotting.sections import Section, captioned, image, write_sections
from megalopta.plotting.style import BLUE, ORANGE
from megalopta.plotting.text import level_name, lux, number
from megalopta.render import SceneRenderer, frame_seed, read_picture
from megalopta.report.denoised import NOTE, denoised, pixel_albedo
from megalopta.report.images import data_uri, gray_counts, write_sheet
from megalopta.scenes import preview
from megalopta.scenes.lighting.levels import LEVELS
from megalopta.scenes.scene import Scene
from megalopta.sensor import expose
from megalopta.stages.render import build

Parts = Mapping[str, Any]
"""Parts of a configuration"""
_DATA = strict_yaml.load(Path(__file__).with_suffix(".yaml").read_text("utf-8"))
SCENES: Mapping[str, Parts] = _DATA["scenes"]
VIEWS: Mapping[str, Parts] = _DATA["views"]
_WIDTH = 196


@dataclass(frozen=True)
class LitScene:
    """One scene in one light."""

    scene: str
    level: str
    view: NDArray[np.uint8]
    """Radiance (H, W, 3), denoised, exposed and white-balanced for its own light"""
    counts: NDArray[np.integer | np.floating]
    """Readings of a sensor in one exposure (H, W)"""
    canopy: str
    """Measured density and transmission of a forest; empty if unknown"""

    @property
    def light(self) -> str:
        """Name and strength of the light."""
        return f"{level_name(self.level)}, {lux(LEVELS[self.level].illuminance_lux)}"

    @property
    def photons(self) -> str:
        """Mean count per pixel, as text."""
        return f"{number(float(np.mean(self.counts)))} photons per pixel"


def write_gallery(
    out: Path, scenes: Mapping[str, Parts] = SCENES, samples_per_pixel: int | None = None
) -> Path:
    """Render the gallery into a folder; return its page, gallery.html, next to gallery.png."""
    with progress("Rendering the gallery", len(scenes) * len(LEVELS), "view") as advance:
        cells = [[*cells_of(*each, samples_per_pixel, advance)] for each in scenes.items()]
    out.mkdir(parents=True, exist_ok=True)
    write_sheet(out / "gallery.png", [row for each in cells for row in _rows(each)])
    return _write_page(out / "gallery.html", cells)


def configured(kind: str, parts: Parts, samples_per_pixel: int | None, name: str) -> Configuration:
    """Return the configuration of a "scene" or "view", by default with the samples of its kind."""
    samples = {"render": {"samples_per_pixel": samples_per_pixel}} if samples_per_pixel else {}
    return validated(Configuration, merged({**_DATA[f"_{kind}"], **parts}, samples), name)


def cells_of(
    name: str,
    parts: Parts,
    samples_per_pixel: int | None = None,
    advance: Advance = lambda work=1: None,
) -> Iterator[LitScene]:
    """Render one scene in all lights; `parts` are those of a configuration."""
    settings = configured("scene", parts, samples_per_pixel, name)
    scene = build(settings)
    albedo = pixel_albedo(scene, settings, settings.trajectory.poses()[0])
    rendered: dict[str, tuple[Configuration, NDArray[np.float32], NDArray[np.float32], str]] = {}
    for level, light in LEVELS.items():
        # Under a uniform sky levels differ by a factor in each band; a disc has its share in each.
        directions = level if light.disc else "sky"
        if directions not in rendered:
            lit = _under(settings, level)
            radiance, canopy = _radiance(lit, scene)
            rendered[directions] = lit, radiance, denoised(radiance, albedo), canopy
        lit, radiance, clean, canopy = rendered[directions]
        scale = light_scale(lit, level).astype(np.float32)
        white = lit.scene.white(_under(lit, level).light)
        view = preview(clean * scale, lit.render.bands_nm, white)
        counts = _counts(lit, radiance * scale, f"{name}/{level}")
        yield LitScene(name, level, view, counts, canopy)
        advance()


def _under(settings: Configuration, level: str) -> Configuration:
    light = settings.light.model_copy(update={"level": level})
    return settings.model_copy(update={"light": light})


def _radiance(lit: Configuration, scene: Scene) -> tuple[NDArray[np.float32], str]:
    """Return the first frame (H, W, B) of a configuration, and a sentence on its canopy.

    A canopy is measured under a uniform sky; otherwise, and without one, the sentence is empty.
    """
    # A self-luminous scene is as bright as its level, so it is built for each.
    scene = replace(scene, lighting=lit.light.lighting()) if scene.lighting else build(lit)
    poses, ring = lit.trajectory.poses(), lit.scene.canopy_ring_m
    renderer = SceneRenderer(scene, lit.camera, lit.render, poses[:1])
    has_disc = bool(scene.lighting and scene.lighting.sun)
    canopy = str(renderer.canopy(poses, ring)) if ring and not has_disc else ""
    return renderer.radiance(poses[0], frame_seed(lit.seed, 0)), canopy


def _counts(
    settings: Configuration, radiance: NDArray[np.float32], sequence: str
) -> NDArray[np.integer | np.floating]:
    bands, sensor = settings.render.bands_nm, settings.sensors[0]
    light = radiance[np.newaxis]
    exposure = expose(light, bands, sensor, seed=settings.seed, stream=sequence)
    return np.asarray(exposure.counts[0])


def _write_page(path: Path, scenes: Sequence[Sequence[LitScene]]) -> Path:
    """Write all cells as one page, a section per scene; return its path."""
    exposure_s = _DATA["_scene"]["sensors"][0]["exposure_s"]
    sections = []
    for own in scenes:
        canopies = " ".join(dict.fromkeys(cell.canopy for cell in own if cell.canopy))
        figures = tuple(captioned(_both(cell), f"{cell.light}: {cell.photons}") for cell in own)
        name = own[0].scene
        sections.append(Section(name[0].upper() + name[1:], canopies, charts=figures))
    summary = (
        f"Above: rendered radiance, {NOTE} and exposed for its own light, unlike any eye or "
        "camera at night. "
        f"Below: counts of an ideal sensor in {1e3 * exposure_s:g} ms, from black (no photon) to "
        "white (the brightest 1 % of pixels)."
    )
    return write_sections(path, "Scenes and lights", summary, sections)


def _both(cell: LitScene) -> Markup:
    where = f"{cell.scene} in {cell.light}"
    view = image(data_uri(Image.fromarray(cell.view)), f"{where}, exposed for it")
    counts = image(data_uri(gray_counts(cell.counts)), f"photon counts of {where}")
    return view + Markup('<span class="pixels">{}</span>').format(counts)


def _rows(cells: Sequence[LitScene]) -> Iterator[list[tuple[str, Image.Image]]]:
    """Yield two rows of the sheet for a scene: its views, and their counts."""
    height, width = cells[0].view.shape[:2]
    size = _WIDTH, round(_WIDTH * height / width)
    yield [(each.light, Image.fromarray(each.view).resize(size)) for each in cells]
    titles = (f"{each.scene}: {each.photons.removesuffix(' per pixel')}" for each in cells)
    counts = (gray_counts(each.counts).convert("RGB") for each in cells)
    shown = (each.resize(size, Image.Resampling.BOX) for each in counts)
    yield list(zip(titles, shown, strict=True))


_SUMMARY = (
    f"Rendered radiance, {NOTE} and exposed for its own light, unlike any eye or camera at night. "
    "With photons given: counts of an ideal sensor, drawn from the light as rendered, from black "
    "(none) to white (the brightest 1 % of pixels)."
)


def of_photograph(panorama: Path) -> dict[str, Parts]:
    """A photograph, and a clearing in its light, seen by the same camera."""
    scene, day = {"kind": "panorama", "file": str(panorama)}, {"level": "daylight"}
    clearing, light = VIEWS["A clearing at noon"], {**day, "panorama": str(panorama)}
    return {
        "A photographed forest": {**clearing, "scene": scene, "light": day},
        "A clearing in its light": {**clearing, "light": light},
    }


def write_views(
    out: Path,
    panorama: Path | None = None,
    views: Mapping[str, Parts] = VIEWS,
    samples_per_pixel: int | None = None,
) -> Path:
    """Render the views into a folder; return their page, views.html, next to views.jpg.

    Raises UserError if there is no such panorama; ValueError if the panorama cannot be read as a
    picture.
    """
    views = {**(of_photograph(panorama) if panorama else {}), **views}
    settings = [configured("view", parts, samples_per_pixel, each) for each, parts in views.items()]
    pictures: list[tuple[str, Image.Image]] = []
    with progress("Rendering views", len(views), "view") as advance:
        for (title, parts), each in zip(views.items(), settings, strict=True):
            pictures += _pictures(title, each, "sensors" in parts)
            advance()
    out.mkdir(parents=True, exist_ok=True)
    write_sheet(out / "views.jpg", [pictures[at : at + 2] for at in range(0, len(pictures), 2)])
    shown = tuple(captioned(image(data_uri(each), title), title) for title, each in pictures)
    sections = [Section("Views", charts=shown)]
    return write_sections(out / "views.html", "Forests under natural skies", _SUMMARY, sections)


def _pictures(
    title: str, settings: Configuration, is_counted: bool
) -> Iterator[tuple[str, Image.Image]]:
    """Yield a view with its title, and its counts if requested."""
    scene, pose = build(settings), settings.trajectory.poses()[:1]
    renderer = SceneRenderer(scene, settings.camera, settings.render, pose)
    radiance = renderer.radiance(pose[0], frame_seed(settings.seed, 0))
    light = denoised(radiance, pixel_albedo(scene, settings, pose[0]))
    white = settings.scene.white(settings.light)
    yield title, Image.fromarray(preview(light, settings.render.bands_nm, white))
    if is_counted:
        counts, exposure_s = _counts(settings, radiance, "view"), settings.sensors[0].exposure_s
        mean = f"{counts.mean():.2g} photons per pixel in {exposure_s:g} s"
        yield f"{title}: {mean}", gray_counts(counts).convert("RGB")


STATISTICS_PRESETS = "open", "clearing", "dense", "understorey", "rainforest", "trail"
STATISTICS_SAMPLES = 64
"""Samples per pixel and pass"""

DIRECTIONS = 4
FINEST_DEG = 0.3
"""Angle of a pixel without photographs (deg)"""

BLUR_PX = 0.7
"""Standard deviation of a lens's blur (px)"""

_FOV_DEG, _EYE_M = 75.0, 1.6
_STEP_DEG = 0.05
_TITLES = {
    "contrast": "standard deviation",
    "skewness": "skewness",
    "kurtosis": "kurtosis",
    "neighbor_correlation": "correlation",
    "gradient_contrast": "σ of differences",
    "gradient_kurtosis": "their kurtosis",
    "spectrum_slope": "spectral exponent",
}
_ALIKE = 1.3
"""Factor within which a statistic counts as near a photograph's"""


def write_statistics(
    out: Path,
    panoramas: Sequence[Path] = (),
    samples_per_pixel: int = STATISTICS_SAMPLES,
    presets: Sequence[str] = STATISTICS_PRESETS,
    side_px: int | None = None,
) -> list[Path]:
    """Render the views and write image-statistics.png, .svg, .csv and .json into a folder.

    Panoramas are photographs of the full sphere: HDR, EXR or PNG files, 2:1. Each of eight
    renderings of a view of 75° takes `samples_per_pixel` light paths per pixel; its side is by
    default that of 0.3° per pixel, or of two pixels of the coarsest photograph. Raises UserError or
    ValueError if a panorama does not exist or cannot be read.
    """
    side_px = side_px or round(_FOV_DEG / degrees_per_px(panoramas))
    scenes = {each.stem: {"kind": "panorama", "file": str(each)} for each in panoramas}
    scenes |= {preset: {"kind": "forest", "preset": preset} for preset in presets}
    settings = {
        name: _statistics_settings(name, scene, samples_per_pixel, side_px)
        for name, scene in scenes.items()
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

    Raises ValueError if a photograph cannot be read.
    """
    coarsest = max((360 / read_picture(str(each)).shape[1] for each in panoramas), default=0.0)
    return max(FINEST_DEG, _STEP_DEG * math.ceil(2 * coarsest / _STEP_DEG))


def _statistics_settings(
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
        for repeat in range(PASSES):
            light = renderer.radiance(pose, frame_seed(settings.seed, index, repeat))[..., 0]
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
        title="Statistics of log radiance in views of forests",
        caption=(
            f"Mean and standard error over {DIRECTIONS} views of {_FOV_DEG:g}° at "
            f"{_FOV_DEG / side_px:.3g}° per pixel from {_EYE_M:g} m, in daylight{shaded} (for the "
            "correlation: its distance from 1). Blurred: by "
            f"{BLUR_PX:g} px, as by a lens. Differences and correlation: neighbors along rows; "
            "exponent: power over radial frequency. Noise is removed by "
            f"products of {PASSES} renderings, of whose pixels at most "
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
    """Draw a panel per statistic, a line per scene."""
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
