"""Section "The true motion": flow, depth, occlusion and objects of the frames shown."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from PIL import Image

from megalopta.flow.files import flow_to_rgb, wheel_legend
from megalopta.render.truth import Truth
from megalopta.report.charts import speed_chart
from megalopta.report.components import Picture, film
from megalopta.report.footage import ReportFrames, Selection
from megalopta.report.images import ORANGE, data_uri, id_picture, map_scale, rgb_picture
from megalopta.report.text import percent

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


def motion_section(footage: ReportFrames) -> MotionSection:
    """Section of the frames shown."""
    flow = np.stack([truth.flow_forward for truth in footage.truths])
    speed = np.linalg.norm(flow, axis=-1)
    speed = speed[np.isfinite(speed)]
    wheel = _wheel(speed)
    median = float(np.median(speed)) if speed.size else 0.0
    occluded = np.mean([truth.occluded_forward.mean() for truth in footage.truths])
    return MotionSection(
        wheel=wheel,
        pictures=(
            _flow_film(footage, wheel),
            _depth_film(footage),
            _occlusion_film(footage),
            _object_film(footage),
        ),
        chart=speed_chart(speed, median),
        median_speed=median,
        occluded=percent(float(occluded)),
        objects_seen=len(_seen(footage.truths)),
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
    near, far = _range(depth)
    scale = map_scale("viridis_r", near, far, logarithmic=True)
    legend = scale.legend(f"{near:.2g}", f"{far:.2g} m", "sky" if np.isnan(depth).any() else "")
    return film([scale.picture(each) for each in depth], "depth", "Depth of the scene", legend)


def _range(depth: NDArray[np.floating]) -> tuple[float, float]:
    known = depth[np.isfinite(depth)]
    if not known.size:
        return 1.0, 10.0
    near, far = (float(each) for each in np.percentile(known, (0.5, 99.5)))
    return near, max(far, 1.01 * near)


def _occlusion_film(footage: ReportFrames) -> Picture:
    images = [
        rgb_picture(_marked(preview, truth, footage.selection))
        for preview, truth in zip(footage.previews, footage.truths, strict=True)
    ]
    return film(images, "hidden in the next frame", "Pixels hidden in the next frame, in orange")


def _marked(preview: NDArray[np.uint8], truth: Truth, selection: Selection) -> NDArray[np.uint8]:
    """The scene dimmed to gray with the pixels that will be hidden in orange."""
    step = selection.step
    gray = preview[::step, ::step].mean(axis=-1) * _BACKDROP_GRAY
    picture = np.repeat(gray[..., np.newaxis], 3, axis=-1).astype(np.uint8)
    picture[truth.occluded_forward[::step, ::step]] = ORANGE
    return picture


def _object_film(footage: ReportFrames) -> Picture:
    step = footage.selection.step
    images = [id_picture(truth.object_id[::step, ::step]) for truth in footage.truths]
    return film(images, "objects", "Each object in a color of its own, the sky dark")


def _seen(truths: Sequence[Truth]) -> NDArray[np.uint32]:
    numbers = np.unique(np.concatenate([np.unique(truth.object_id) for truth in truths]))
    return numbers[numbers > 0]
