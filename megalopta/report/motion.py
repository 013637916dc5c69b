"""Section "The true motion": flow, depth, occlusion and objects of the frames shown."""

from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from PIL import Image

from megalopta.flow.files.color_wheel import flow_to_rgb, wheel_legend
from megalopta.plotting.text import percent
from megalopta.report.charts import speed_chart
from megalopta.report.components import Picture, film
from megalopta.report.footage import ReportFrames
from megalopta.report.images import ORANGE, data_uri, id_picture, map_scale, rgb_picture

_WHEEL_PX = 96
_FASTEST_PERCENT = 99.0
_SMALLEST_SPEED = 1e-3
_BACKDROP_GRAY = 0.35


@dataclass(frozen=True)
class Wheel:
    """The legend of flow in color: picture and speed at its rim (px per frame)."""

    picture: str
    max_speed: float


@dataclass(frozen=True)
class MotionSection:
    """Pictures of the truth, and what they amount to."""

    wheel: Wheel
    pictures: tuple[Picture, ...]
    chart: Markup
    median_speed: float
    occluded: str
    objects_seen: int
    mixed: str
    """Share of pixels that are mixed, as the flow stage has it."""


def motion_section(footage: ReportFrames, least_purity: float) -> MotionSection:
    """Section of the frames shown; pixels of less purity are mixed."""
    flow = np.stack([truth.flow_forward for truth in footage.truths])
    speed = np.linalg.norm(flow, axis=-1)
    speed = speed[np.isfinite(speed)]
    wheel = _wheel(speed)
    median = float(np.median(speed)) if speed.size else 0.0
    occluded = np.mean([truth.occluded_forward.mean() for truth in footage.truths])
    mixed = np.mean([(truth.footprint.purity < least_purity).mean() for truth in footage.truths])
    return MotionSection(
        wheel=wheel,
        pictures=(
            _flow_film(footage, wheel),
            _depth_film(footage),
            _occlusion_film(footage),
            _purity_film(footage),
            _object_film(footage),
        ),
        chart=speed_chart(speed, median),
        median_speed=median,
        occluded=percent(float(occluded)),
        mixed=percent(float(mixed)),
        objects_seen=len(set(np.unique([truth.object_id for truth in footage.truths])) - {0}),
    )


def _wheel(speed: NDArray[np.floating]) -> Wheel:
    fastest = float(np.percentile(speed, _FASTEST_PERCENT)) if speed.size else 0.0
    digits = float(f"{max(fastest, _SMALLEST_SPEED):.1e}")
    return Wheel(data_uri(Image.fromarray(wheel_legend(_WHEEL_PX))), digits)


def _flow_film(footage: ReportFrames, wheel: Wheel) -> Picture:
    step = footage.selection.step
    images = [
        rgb_picture(flow_to_rgb(truth.flow_forward[::step, ::step], wheel.max_speed))
        for truth in footage.truths
    ]
    return film(images, "true motion", "True motion to the next frame, colors as on the wheel")


def _depth_film(footage: ReportFrames) -> Picture:
    depth = footage.selection.pixels(np.stack([truth.depth for truth in footage.truths]))
    depth = np.where(np.isfinite(depth), depth, np.nan)
    near, far = 1.0, 10.0
    if not np.isnan(depth).all():
        near, far = (float(each) for each in np.nanpercentile(depth, (0.5, 99.5)))
        far = max(far, 1.01 * near)
    scale = map_scale("viridis_r", near, far, logarithmic=True)
    legend = scale.legend(f"{near:.2g}", f"{far:.2g} m", "sky" if np.isnan(depth).any() else "")
    return film([scale.picture(each) for each in depth], "depth", "Depth of the scene", legend)


def _occlusion_film(footage: ReportFrames) -> Picture:
    """The scene dimmed to gray with the pixels that will be hidden in orange."""
    step, images = footage.selection.step, []
    for preview, truth in zip(footage.previews, footage.truths, strict=True):
        gray = preview[::step, ::step].mean(axis=-1) * _BACKDROP_GRAY
        picture = np.repeat(gray[..., np.newaxis], 3, axis=-1).astype(np.uint8)
        picture[truth.occluded_forward[::step, ::step]] = ORANGE
        images.append(rgb_picture(picture))
    return film(images, "hidden in the next frame", "Pixels hidden in the next frame, in orange")


def _purity_film(footage: ReportFrames) -> Picture:
    purity = footage.selection.pixels(
        np.stack([truth.footprint.purity for truth in footage.truths])
    )
    scale = map_scale("viridis", 0.0, 1.0)
    caption = "Share of each pixel that the object fills which its center sees"
    return film([scale.picture(each) for each in purity], "purity", caption, scale.legend("0", "1"))


def _object_film(footage: ReportFrames) -> Picture:
    step = footage.selection.step
    images = [id_picture(truth.object_id[::step, ::step]) for truth in footage.truths]
    return film(images, "objects", "Each object in a color of its own, the sky dark")
