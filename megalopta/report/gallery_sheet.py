"""Every scene preset at every light level: the view as if it were day, and the photons of it.

A scene is built once and rendered twice, with and without a disc in the sky, since these cast other
shadows; the levels of each kind differ by a factor in every band. The view is exposed for its own
light, which no eye and no camera can do at night; below it stand the counts of a sensor that sees
nothing but photons.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.config.light_scale import light_scale
from megalopta.config.model import Configuration
from megalopta.core.progress import Advance, progress
from megalopta.render import SceneRenderer, frame_seed
from megalopta.report.gallery_page import Cell, write_page, write_sheet
from megalopta.scenes import preview, white_of
from megalopta.scenes.forest.stand import PRESETS
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


def write_gallery(
    out: Path, scenes: Mapping[str, Mapping[str, Any]] = SCENES, samples_per_pixel: int = 49
) -> Path:
    """Render the gallery into a folder; returns its page, gallery.html, beside gallery.png."""
    with progress("Rendering the gallery", len(scenes) * len(LEVELS), "view") as advance:
        cells = [
            cell
            for name, parts in scenes.items()
            for cell in _cells(name, parts, samples_per_pixel, advance)
        ]
    out.mkdir(parents=True, exist_ok=True)
    write_sheet(out / "gallery.png", cells)
    write_page(out / "gallery.html", cells, _EXPOSURE_S)
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
    return Cell(name, level, LEVELS[level].illuminance_lux, view, exposure.counts[0])
