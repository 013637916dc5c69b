"""Every scene preset at every light level: the view as if it were day, and the photons of it.

A scene is built once; under each light it is rendered anew, since sun, moon and open sky cast
different shadows. The view is exposed for its own light, which no eye and no camera can do at
night; below it stand the counts of a sensor that sees nothing but photons.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from megalopta.configuration import Configuration
from megalopta.gallery_page import Cell, write_page, write_sheet
from megalopta.preview import preview
from megalopta.progress import Advance, progress
from megalopta.render.renderer import SceneRenderer
from megalopta.render.settings import frame_seed
from megalopta.scenes.build import build_scene
from megalopta.scenes.light import LEVELS
from megalopta.scenes.scene import Scene
from megalopta.scenes.spectrum import flat
from megalopta.sensor import expose_image

_CAMERA = {"width": 300, "height": 200, "fov_deg": 75}
_PATH = {"frames": 2, "look_at_m": [10, 0, 1.8], "velocity_m_s": [1.0, 0.3, 0]}

SCENES: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        **{
            f"{preset} forest": {"scene": {"kind": "forest", "preset": preset}}
            for preset in ("open", "dense", "understorey", "clearing")
        },
        "grating": {"scene": {"kind": "grating", "cycles_per_frame": 8}, "trajectory": {}},
    }
)
"""What the gallery shows, as parts of a configuration."""


def write_gallery(
    out: Path, scenes: Mapping[str, Mapping[str, Any]] = SCENES, samples_per_pixel: int = 64
) -> Path:
    """Render the gallery into a folder; returns its page, gallery.html, beside gallery.png."""
    with progress("Rendering the gallery", len(scenes) * len(LEVELS), "view") as advance:
        cells = [
            cell
            for name in scenes
            for cell in _cells(name, scenes[name], samples_per_pixel, advance)
        ]
    out.mkdir(parents=True, exist_ok=True)
    write_sheet(out / "gallery.png", cells)
    write_page(out / "gallery.html", cells)
    return out / "gallery.html"


def _cells(
    name: str, parts: Mapping[str, Any], samples_per_pixel: int, advance: Advance
) -> Iterator[Cell]:
    values = {
        "camera": _CAMERA,
        "trajectory": _PATH,
        "render": {"samples_per_pixel": samples_per_pixel},
        "sensors": ["ideal"],
        **parts,
    }
    settings = Configuration.model_validate(values)
    scene = _build(settings)
    for level in LEVELS:
        yield _cell(name, level, settings, scene)
        advance()


def _cell(name: str, level: str, settings: Configuration, day: Scene) -> Cell:
    lit = settings.model_copy(update={"light": settings.light.model_copy(update={"level": level})})
    light = lit.light.resolved()
    # What glows by itself is as bright as the light of its level, so it is built for each.
    scene = replace(day, lighting=lit.light.lighting()) if day.lighting else _build(lit)
    renderer = SceneRenderer(scene, lit.camera, lit.render)
    radiance = renderer.radiance(lit.trajectory.poses()[0], frame_seed(lit.seed, 0))
    white = light.spectrum() if day.lighting else flat(1.0)
    exposure = expose_image(
        radiance[np.newaxis], lit.render.bands_nm, lit.sensors[0], seed=lit.seed, sequence=level
    )
    view = preview(radiance, lit.render.bands_nm, white)
    return Cell(name, level, light.illuminance_lux, view, exposure.counts[0])


def _build(settings: Configuration) -> Scene:
    return build_scene(
        settings.scene, settings.light, settings.camera, settings.trajectory, settings.objects
    )
