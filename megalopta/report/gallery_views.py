"""Larger views of forests under natural skies: noon, sunset, starlight, close by and all around.

With a photographed panorama there are two more: the photograph through the same camera, and a
forest in its light.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from megalopta.config.model import Configuration
from megalopta.config.yaml_model import validated
from megalopta.core.files import atomic_write
from megalopta.core.progress import progress
from megalopta.plotting.sections import Section, captioned, image, write_sections
from megalopta.render import SceneRenderer, frame_seed
from megalopta.report.images import data_uri, gray_counts
from megalopta.report.scene_gallery import ALONG_THE_TRAIL
from megalopta.scenes import preview, white_of
from megalopta.sensor import expose
from megalopta.stages.render import build

SAMPLES = 64
"""Per pixel."""
_CAMERA = {"width": 360, "height": 240, "fov_deg": 75}
_AHEAD = {"frames": 2, "look_at_m": [10, 0, 2.4]}
_FLOOR = {"frames": 2, "look_at_m": [6, 0, 1.0]}
_LOW = {"frames": 2, "position_m": [0, 0, 0.7], "look_at_m": [2.5, 0.6, 0.35]}
_NOON = {"level": "daylight", "sky": "natural", "disc_azimuth_deg": 150}
_CLOUDY = {"level": "daylight", "sky": "natural", "cloud_cover": 1.0}
_FOG_M = 60.0
"""Visibility"""
_GAP, _LINE = 8, 20
_SUMMARY = (
    "Rendered radiance, exposed for its own light, as no eye and no camera sees it at night; where "
    "photons are given, what an ideal sensor counts, from black for none to white for the "
    "brightest hundredth of its pixels."
)


@dataclass(frozen=True)
class GalleryView:
    """Content of one picture."""

    title: str
    parts: Mapping[str, Any]
    """Of a configuration."""
    exposure_s: float | None = None
    """Of an ideal sensor whose counts are shown, too."""
    work: int = 1
    """Times the samples of other views: light in fog is noisy."""


@dataclass(frozen=True)
class Picture:
    """A view as it is shown."""

    title: str
    image: NDArray[np.uint8]
    """(H, W, 3)"""


def _forest(preset: str, light: Mapping[str, Any], path: Mapping[str, Any]) -> dict[str, Any]:
    return {"scene": {"kind": "forest", "preset": preset}, "light": light, "trajectory": path}


def _foggy(parts: Mapping[str, Any]) -> dict[str, Any]:
    return {**parts, "scene": {**parts["scene"], "haze": {"visibility_m": _FOG_M}}}


VIEWS = (
    GalleryView("A clearing at noon", _forest("clearing", _NOON, _AHEAD)),
    GalleryView(
        "An open forest where the sun went down",
        _forest("open", {"level": "twilight", "sky": "natural", "disc_azimuth_deg": 0}, _AHEAD),
    ),
    GalleryView("The floor of a rain forest at noon", _forest("rainforest", _NOON, _FLOOR)),
    GalleryView(
        "The same by starlight",
        _forest("rainforest", {"level": "starlight", "sky": "natural"}, _FLOOR),
        exposure_s=0.1,
    ),
    GalleryView("A trail through a mixed wood at noon", _forest("trail", _NOON, ALONG_THE_TRAIL)),
    GalleryView(
        "The same in fog, under a cloud", _foggy(_forest("trail", _CLOUDY, ALONG_THE_TRAIL)), work=4
    ),
    GalleryView(
        "Close to the ground",
        {
            **_forest("understorey", _NOON, _LOW),
            "camera": {**_CAMERA, "fov_deg": 45},
        },
    ),
    GalleryView(
        "All around, in a dense forest",
        {
            **_forest("dense", _NOON, {"frames": 2, "look_at_m": [10, 0, 1.5]}),
            "camera": {"kind": "equirectangular", "width": 480, "height": 240},
        },
    ),
)


def of_photograph(panorama: Path, turn_deg: float = 0.0) -> tuple[GalleryView, GalleryView]:
    """A photograph, and a clearing in its light, seen by the same camera."""
    scene = {"kind": "panorama", "file": str(panorama), "turn_deg": turn_deg}
    light = {"level": "daylight", "panorama": str(panorama), "panorama_turn_deg": turn_deg}
    day = {"level": "daylight"}
    return (
        GalleryView("A photographed forest", {"scene": scene, "light": day, "trajectory": _AHEAD}),
        GalleryView("A clearing in its light", _forest("clearing", light, _AHEAD)),
    )


def write_views(
    out: Path,
    panorama: Path | None = None,
    views: Sequence[GalleryView] = VIEWS,
    samples_per_pixel: int = SAMPLES,
) -> Path:
    """Render the views into a folder; return their page, views.html, beside views.jpg.

    Raises
    ------
    UserError
        When there is no such panorama.
    ValueError
        When the panorama cannot be read as a picture.
    """
    views = [*(of_photograph(panorama) if panorama else ()), *views]
    settings = [_settings(view, samples_per_pixel * view.work) for view in views]
    pictures: list[Picture] = []
    with progress("Rendering views", len(views), "view") as advance:
        for view, each in zip(views, settings, strict=True):
            pictures += _pictures(view, each)
            advance()
    out.mkdir(parents=True, exist_ok=True)
    _write_sheet(out / "views.jpg", pictures)
    figures = [(data_uri(Image.fromarray(each.image)), each.title) for each in pictures]
    shown = tuple(captioned(image(uri, title), title) for uri, title in figures)
    section = Section("Views", charts=shown)
    write_sections(out / "views.html", "Forests under natural skies", _SUMMARY, [section])
    return out / "views.html"


def _settings(view: GalleryView, samples_per_pixel: int) -> Configuration:
    values = {
        "camera": _CAMERA,
        "render": {"samples_per_pixel": samples_per_pixel, "integrator": "path"},
        "sensors": [{"preset": "ideal", "exposure_s": view.exposure_s or 1e-3}],
        **view.parts,
    }
    return validated(Configuration, values, view.title)


def _pictures(view: GalleryView, settings: Configuration) -> Iterator[Picture]:
    renderer = SceneRenderer(build(settings), settings.camera, settings.render)
    radiance = renderer.radiance(settings.trajectory.poses()[0], frame_seed(settings.seed, 0))
    bands = settings.render.bands_nm
    yield Picture(view.title, preview(radiance, bands, white_of(settings.scene, settings.light)))
    if view.exposure_s:
        exposure = expose(
            radiance[np.newaxis], bands, settings.sensors[0], seed=settings.seed, sequence="view"
        )
        counts = exposure.counts[0]
        told = f"{view.title}: {counts.mean():.2g} photons per pixel in {view.exposure_s:g} s"
        yield Picture(told, np.asarray(gray_counts(counts).convert("RGB")))


def _write_sheet(path: Path, pictures: Sequence[Picture]) -> None:
    """Write all pictures as one JPEG, two in a row, wider ones alone, with their titles."""
    rows = _rows(pictures)
    whole = 2 * min(each.image.shape[1] for each in pictures) + _GAP
    height = sum(row[0][1].height + _LINE + _GAP for row in rows) + _GAP
    sheet = Image.new("RGB", (whole + 2 * _GAP, height), (255, 255, 255))
    draw, font, top = ImageDraw.Draw(sheet), ImageFont.load_default(14), _GAP
    for row in rows:
        left = _GAP
        for title, picture in row:
            sheet.paste(picture, (left, top))
            draw.text((left, top + picture.height + 2), title, (26, 26, 26), font)
            left += picture.width + _GAP
        top += row[0][1].height + _LINE + _GAP
    with atomic_write(path) as temporary:
        sheet.save(temporary, "JPEG", quality=88)


def _rows(pictures: Sequence[Picture]) -> list[list[tuple[str, Image.Image]]]:
    """Return two pictures of the least width in each row, wider ones as wide as both, alone."""
    width = min(each.image.shape[1] for each in pictures)
    whole = 2 * width + _GAP
    rows: list[list[tuple[str, Image.Image]]] = []
    for each in pictures:
        picture = Image.fromarray(each.image)
        is_wide = picture.width > width
        if is_wide:
            picture = picture.resize((whole, round(whole * picture.height / picture.width)))
        if is_wide or not rows or len(rows[-1]) == 2 or rows[-1][0][1].width > width:
            rows.append([])
        rows[-1].append((each.title, picture))
    return rows
