"""Every scene preset at every light level: the view as if it were day, and the photons of it.

A scene is built once and rendered twice, with and without a disc in the sky, since these cast other
shadows; the levels of each kind differ by a factor in every band. The view is exposed for its own
light, which no eye and no camera can do at night; below it stand the counts of a sensor that sees
nothing but photons.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from megalopta.config.light_scale import light_scale
from megalopta.config.model import Configuration
from megalopta.core.files import atomic_write
from megalopta.core.progress import Advance, progress
from megalopta.plotting.sections import Section, captioned, image, write_sections
from megalopta.plotting.text import level_name, lux, number
from megalopta.render import SceneRenderer, frame_seed
from megalopta.report.images import data_uri, gray_counts
from megalopta.scenes import preview, white_of
from megalopta.scenes.forest.plants import PRESETS
from megalopta.scenes.lighting.levels import LEVELS
from megalopta.scenes.scene import Scene
from megalopta.sensor import expose_image
from megalopta.stages.render import build

_CAMERA = {"width": 270, "height": 180, "fov_deg": 75}
_PATH = {"frames": 2, "look_at_m": [10, 0, 1.8], "velocity_m_s": [1.0, 0.3, 0]}
_EXPOSURE_S = 2e-3
_TURNING = {
    "camera": {**_CAMERA, "fov_deg": 72},
    "trajectory": {"frames": 2, "rotation_deg_s": 15},
}

ALONG_THE_TRAIL = {"frames": 2, "position_m": [0, 0, 1.6], "look_at_m": [10, 0, 0.6]}
_NAMES = {"rainforest": "rain forest", "trail": "trail"}

SCENES: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        **{
            _NAMES.get(preset, f"{preset} forest"): {
                "scene": {"kind": "forest", "preset": preset},
                "trajectory": ALONG_THE_TRAIL if preset == "trail" else _PATH,
            }
            for preset in PRESETS
        },
        "grating": {"scene": {"kind": "grating"}, **_TURNING},
        "random dots": {"scene": {"kind": "grating", "pattern": "dots"}, **_TURNING},
        "board": {"scene": {"kind": "plane", "pattern": "square"}},
        "motion bench": {
            "scene": {"kind": "motion_bench", "edge_mm": -5},
            "trajectory": {"frames": 2, "velocity_m_s": [0, -0.001, 0]},
        },
    }
)
"""What the gallery shows, as parts of a configuration."""
_WIDTH, _GAP, _LINE = 188, 6, 18
_PAPER, _INK, _FAINT = (255, 255, 255), (26, 26, 26), (110, 110, 110)


@dataclass(frozen=True)
class Cell:
    """One scene in one light."""

    scene: str
    level: str
    view: NDArray[np.uint8]
    """The radiance (H, W, 3), exposed and white-balanced for its own light"""
    counts: NDArray[np.integer | np.floating]
    """Of a sensor, in one exposure (H, W)"""
    canopy: str = ""
    """What a forest holds and lets through, measured; empty where that is not known"""

    @property
    def light(self) -> str:
        """Name and strength of the light."""
        return _plain(f"{level_name(self.level)}, {lux(LEVELS[self.level].illuminance_lux)}")

    @property
    def photons(self) -> str:
        """Mean count."""
        return _plain(f"{number(float(np.mean(self.counts)))} photons per pixel")


def _plain(text: str) -> str:
    """Return a text with plain spaces: the sheet's font knows no others."""
    return " ".join(text.split())


def write_gallery(
    out: Path, scenes: Mapping[str, Mapping[str, Any]] = SCENES, samples_per_pixel: int = 49
) -> Path:
    """Render the gallery into a folder; return its page, gallery.html, beside gallery.png."""
    with progress("Rendering the gallery", len(scenes) * len(LEVELS), "view") as advance:
        cells = [
            cell
            for name, parts in scenes.items()
            for cell in _cells(name, parts, samples_per_pixel, advance)
        ]
    out.mkdir(parents=True, exist_ok=True)
    write_sheet(out / "gallery.png", cells)
    _write_page(out / "gallery.html", cells)
    return out / "gallery.html"


def _cells(
    name: str, parts: Mapping[str, Any], samples_per_pixel: int, advance: Advance
) -> Iterator[Cell]:
    values = {
        "camera": _CAMERA,
        "trajectory": _PATH,
        "render": {"samples_per_pixel": samples_per_pixel},
        "sensors": [{"preset": "ideal", "exposure_s": _EXPOSURE_S}],
        **parts,
    }
    settings = Configuration.model_validate(values)
    scene = build(settings)
    rendered: dict[str, tuple[Configuration, NDArray[np.float32], str]] = {}
    for level, light in LEVELS.items():
        # Under an even sky levels differ by a factor in each band; a disc has a share in each.
        directions = level if light.disc else "sky"
        if directions not in rendered:
            lit = _under(settings, level)
            rendered[directions] = lit, *_radiance(lit, scene)
        lit, radiance, canopy = rendered[directions]
        scaled = radiance * light_scale(lit, level).astype(np.float32)
        yield replace(_cell(name, level, lit, scaled), canopy=canopy)
        advance()


def _under(settings: Configuration, level: str) -> Configuration:
    light = settings.light.model_copy(update={"level": level})
    return settings.model_copy(update={"light": light})


def _radiance(lit: Configuration, scene: Scene) -> tuple[NDArray[np.float32], str]:
    """First frame (H, W, B) of a scene under the light of a configuration, and of its canopy.

    A canopy is measured under an even sky; else, and without one, nothing is told.
    """
    # What glows by itself is as bright as the light of its level, so it is built for each.
    scene = replace(scene, lighting=lit.light.lighting()) if scene.lighting else build(lit)
    renderer = SceneRenderer(scene, lit.camera, lit.render)
    poses, ring = lit.trajectory.poses(), lit.scene.canopy_ring_m
    has_disc = bool(scene.lighting and scene.lighting.sun)
    canopy = str(renderer.canopy(poses, ring)) if ring and not has_disc else ""
    return renderer.radiance(poses[0], frame_seed(lit.seed, 0)), canopy


def _cell(name: str, level: str, lit: Configuration, radiance: NDArray[np.float32]) -> Cell:
    bands = lit.render.bands_nm
    exposure = expose_image(
        radiance[np.newaxis], bands, lit.sensors[0], seed=lit.seed, sequence=f"{name}/{level}"
    )
    view = preview(radiance, bands, white_of(lit.scene, _under(lit, level).light))
    return Cell(name, level, view, exposure.counts[0])


def _write_page(path: Path, cells: Sequence[Cell]) -> None:
    """Write all cells as one page, a section for each scene."""
    sections = []
    for scene, group in groupby(cells, lambda cell: cell.scene):
        own = list(group)
        canopies = " ".join(dict.fromkeys(cell.canopy for cell in own if cell.canopy))
        figures = tuple(captioned(_pictures(cell), f"{cell.light}: {cell.photons}") for cell in own)
        sections.append(Section(scene[0].upper() + scene[1:], canopies, charts=figures))
    summary = (
        "Above: the rendered radiance, exposed for its own light, as no eye and no camera sees it "
        f"at night. Below: what an ideal sensor counts in {1e3 * _EXPOSURE_S:g} ms, from black for "
        "no photon to white for the brightest hundredth of its pixels."
    )
    write_sections(path, "Scenes and lights", summary, sections)


def _pictures(cell: Cell) -> Markup:
    where = f"{cell.scene} in {cell.light}"
    view = image(data_uri(Image.fromarray(cell.view)), f"{where}, exposed for it")
    counts = image(data_uri(gray_counts(cell.counts)), f"photon counts of {where}")
    return view + Markup('<span class="pixels">{}</span>').format(counts)


def write_sheet(path: Path, cells: Sequence[Cell]) -> None:
    """Write all cells as one PNG: a row of views and a row of counts for each scene."""
    rows = [list(group) for _, group in groupby(cells, lambda cell: cell.scene)]
    height, width = cells[0].view.shape[:2]
    size = (_WIDTH, round(_WIDTH * height / width))
    row_height, head = 2 * (size[1] + _LINE) + 2 * _GAP, 2 * _LINE + _GAP
    whole = max(map(len, rows)) * (_WIDTH + _GAP) + _GAP, head + len(rows) * row_height
    sheet = Image.new("RGB", whole, _PAPER)
    draw = ImageDraw.Draw(sheet)
    for column, cell in enumerate(rows[0]):
        left = _GAP + column * (_WIDTH + _GAP)
        draw.text((left, _GAP), cell.light.replace(", ", "\n"), _INK, ImageFont.load_default(12))
    for row, group in enumerate(rows):
        top = head + row * row_height
        draw.text((_GAP, top), group[0].scene, _INK, ImageFont.load_default(14))
        for column, cell in enumerate(group):
            _paste(sheet, cell, (_GAP + column * (_WIDTH + _GAP), top + _LINE), size)
    with atomic_write(path) as temporary:
        sheet.quantize(256).save(temporary, "PNG", optimize=True)


def _paste(sheet: Image.Image, cell: Cell, at: tuple[int, int], size: tuple[int, int]) -> None:
    left, below = at[0], at[1] + size[1] + _GAP
    sheet.paste(Image.fromarray(cell.view).resize(size, Image.Resampling.LANCZOS), at)
    counts = gray_counts(cell.counts).convert("RGB").resize(size, Image.Resampling.BOX)
    sheet.paste(counts, (left, below))
    text = (left, below + size[1] + 1)
    ImageDraw.Draw(sheet).text(text, cell.photons, _FAINT, ImageFont.load_default(12))
