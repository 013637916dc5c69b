"""Parts of several sections: what to run, the key of methods, how noisy the rendering itself is.

Light is gathered by random samples, so the "noise-free" frames are themselves a little noisy. The
render stage measures how much, on pixels without sky where there are any: `monte_carlo` in the
scene record.
"""

from collections.abc import Iterator

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import FuncFormatter

from megalopta.core.arrays import Floats
from megalopta.flow.detectors.registry import METHODS
from megalopta.plotting.sections import paragraph
from megalopta.plotting.style import GLYPHS, method_style
from megalopta.plotting.svg import themed
from megalopta.plotting.text import number, percent, short
from megalopta.report.source import Record, Report

NUMBERS = FuncFormatter(lambda value, _: short(value))
"""Labels of a logarithmic axis"""
_CAUTION = 0.1


def drawable(values: Floats) -> Floats:
    """Return what a logarithmic axis can show, with gaps elsewhere."""
    return np.where(values > 0, values, np.nan)


def verbatim(text: str) -> str:
    """Text for matplotlib as it stands, dollar signs included."""
    return text.replace("$", r"\$")


def absent(report: Report, stage: str, what: str) -> Markup:
    """Return what to run where a stage is missing."""
    root = report.dataset.root
    return paragraph(
        Markup(
            "{} To have it here, run <code>megalopta {} {}</code> and then "
            "<code>megalopta report {}</code>."
        ).format(what, stage, root, root),
        "absent",
    )


def rendering(record: Record, consequence: str) -> Markup:
    """Return how noisy the rendering is, as a scene record has it; nothing where it is not known.

    More than a tenth of a pixel's light (median over pixels) is a warning.
    """
    noise = record.get("monte_carlo")
    if not noise or not noise["median_relative"]:
        return Markup("")
    relative = noise["median_relative"]
    caution = Markup("<b>Caution, a noisy rendering.</b> ") if relative > _CAUTION else ""
    photons = number(noise["equivalent_photons_per_pixel"])
    text = Markup(
        "{}The rendering itself is as noisy as {} photons per pixel ({} of a pixel’s light, median "
        "over pixels). {}"
    )
    kind = "warn" if relative > _CAUTION else "note"
    return paragraph(text.format(caution, photons, percent(relative), consequence), kind)


def rendering_errors(record: Record) -> Iterator[tuple[str, str]]:
    """Yield what is known of the error of the rendered light, by what it is."""
    noise = record.get("monte_carlo") or {}
    if noise.get("median_relative"):
        yield "error (RMS), of the mean light", percent(noise["rms_over_mean"])
    if surface := noise.get("surface"):
        yield "on pixels without sky (RMS)", percent(surface["rms"])
        yield "of a pixel's light, 95 % of the image", f"{percent(surface['p95'])} or less"
        yield "of squared differences between neighbors", percent(surface["gradient"])
        yield "of baked light, which moves with surfaces (RMS)", percent(surface["standing"])
        share = percent(surface["standing_gradient"])
        yield "of that, of squared differences between neighbors", share
    if sky := noise.get("sky"):
        yield "in the sky, of its light (RMS)", percent(sky["rms"])
    if shares := record.get("light_left_out"):
        yield "light of longer paths, missing in the worst band", percent(max(shares))


def key(report: Report) -> Markup:
    """Return the markers of all methods in their colors, with their names."""
    line = Markup('<li><span style="color:{}" aria-hidden="true">{}</span> <b>{}</b> {}</li>')
    lines = []
    for name in report.settings.methods:
        style = method_style(name)
        color, glyph = themed(style["color"]), GLYPHS[style["marker"]]
        lines.append(line.format(color, glyph, name, METHODS[name].label))
    return Markup('<ul class="key">{}</ul>').format(Markup("").join(lines))
