"""Section "True motion": flow, depth, occlusion and objects of the frames shown."""

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from megalopta.plotting.sections import Section, block, card, paragraph
from megalopta.plotting.style import BLACK, BLUE
from megalopta.plotting.svg import CHART_PT, in_style, new_axes, to_svg
from megalopta.plotting.text import percent
from megalopta.report.images import (
    COLORS,
    ORANGE,
    film,
    id_picture,
    map_scale,
    rgb_picture,
    wheel,
)
from megalopta.report.source import Report

_SPEED_BINS = 48
_BACKDROP_GRAY = 0.35
_GUIDE = Markup(
    "When the camera rotates, everything moves alike; when it travels, near objects move faster "
    "than far ones. Depth is measured {}; its colors are logarithmic. Orange pixels are occluded "
    "in the next frame. Every object has its own color."
)


def motion_section(report: Report) -> Section:
    """Return the section; for pictures, with the stand-in for true motion."""
    if not report.has_truth:
        return _stand_in(report)
    if not report.shown.motions:
        lead = "A single frame has no motion; its depth and objects are known exactly."
        still = report.shown.film(report.shown.depth), _purity(report), _objects(report)
        return Section("Truth", lead, body=block("strip", *still), name="motion", link="Truth")
    hidden = np.mean([truth.occluded_forward.mean() for truth in report.truths])
    depth = report.shown.film(report.shown.depth)
    films = (flow_film(report), depth, _hidden(report), _purity(report), _objects(report))
    guide = paragraph(_GUIDE.format(report.settings.camera.depth_meaning), "note")
    chart = card("Image speed", speed_chart(report.speed, report.median_speed))
    return Section(
        "True motion",
        "The renderer knows the exact place of every visible point in the next frame. The median "
        f"image speed is {report.median_speed:.2g} px per frame; "
        f"{percent(float(hidden))} of the pixels are occluded in the next frame.",
        body=block("strip", *films)
        + block("pair", block("", wheel(COLORS.format(report.fastest)), guide), chart),
        name="motion",
        link="True motion",
    )


def _stand_in(report: Report) -> Section:
    chart = card("Image speed", speed_chart(report.speed, report.median_speed))
    return Section(
        "Motion of the pictures",
        "The true motion of pictures is unknown. A stand-in replaces it: the flow by DIS between "
        "them without photon noise. It is wrong at occlusions and where there is no texture. "
        f"Its median speed is {report.median_speed:.2g} px per frame.",
        body=block("strip", film(None, "radiance", "The pictures"), flow_film(report))
        + block("pair", block("", wheel(COLORS.format(report.fastest))), chart),
        name="motion",
        link="Motion",
    )


def mixed_share(report: Report) -> str:
    """Return the share of mixed pixels, as defined by the flow stage."""
    least = report.settings.flow.least_purity
    shares = [(motion.purity < least).mean() for motion in report.shown.motions.values()]
    return percent(float(np.mean(shares)))


def flow_film(report: Report) -> Markup:
    """Return the reference motion as a film."""
    return report.shown.film(report.shown.motion(report.motion_name))


def _hidden(report: Report) -> Markup:
    """Return the scene in dim gray, with the pixels to be occluded in orange."""
    images = []
    for frame, truth in zip(report.shown.frames, report.truths, strict=True):
        gray = np.asarray(report.shown.light.picture(frame)).mean(axis=-1) * _BACKDROP_GRAY
        picture = np.repeat(gray[..., np.newaxis], 3, axis=-1).astype(np.uint8)
        picture[report.shown.pixels(truth.occluded_forward)] = ORANGE
        images.append(rgb_picture(picture))
    return film(images, "occluded in the next frame", "Occluded pixels in orange")


def _purity(report: Report) -> Markup:
    scale = map_scale("viridis", 0.0, 1.0)
    caption = "Share of each pixel filled by the object at its center"
    shares = (report.shown.pixels(truth.footprint.purity) for truth in report.truths)
    return film([*map(scale.picture, shares)], "purity", caption, scale.legend("0", "1"))


def _objects(report: Report) -> Markup:
    images = [id_picture(report.shown.pixels(each.object_id)) for each in report.truths]
    return film(images, "objects", "Each object in its own color, the sky dark")


@in_style
def speed_chart(speeds: NDArray[np.floating], median: float) -> Markup:
    """Draw the histogram of the true image speed (px per frame)."""
    figure, axes = new_axes(*CHART_PT)
    axes.hist(
        speeds,
        bins=_SPEED_BINS,
        weights=np.full(speeds.size, 100 / max(speeds.size, 1)),
        histtype="stepfilled",
        color=BLUE,
        alpha=0.85,
    )
    axes.axvline(median, color=BLACK, linewidth=1.2)
    place = ("data", "axes fraction")
    axes.annotate(f" median {median:.2g}", (median, 1), xycoords=place, va="top", fontsize=10.5)
    axes.grid(axis="y")
    axes.set(xlabel="image speed (px per frame)", ylabel="share of pixels (%)")
    axes.set_xlim(0, None)
    return to_svg(figure, "speed", "Histogram of the true image speed")
