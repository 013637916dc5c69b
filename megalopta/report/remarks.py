"""Shared parts of sections: commands to run, key of methods, noise of the rendering.

Light is estimated from random samples, so the "noise-free" frames contain some noise. The render
stage measures it, on pixels without sky if there are any: `monte_carlo` in the scene record.
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
    """Return the values that a logarithmic axis can show, with gaps elsewhere."""
    return np.where(values > 0, values, np.nan)


def verbatim(text: str) -> str:
    """Escape text for matplotlib, dollar signs included."""
    return text.replace("$", r"\$")


def absent(report: Report, stage: str, what: str) -> Markup:
    """Return the command to run for a missing stage."""
    root = report.dataset.root
    return paragraph(
        Markup(
            "{} Run <code>megalopta {} {}</code> and then <code>megalopta report {}</code>."
        ).format(what, stage, root, root),
        "absent",
    )


def rendering(record: Record, consequence: str) -> Markup:
    """Return the noise of the rendering, from a scene record; empty if unknown.

    More than a tenth of a pixel's light (median over pixels) is a warning.
    """
    noise = record.get("monte_carlo")
    if not noise or not noise["median_relative"]:
        return Markup("")
    relative = noise["median_relative"]
    caution = Markup("<b>Caution: noisy rendering.</b> ") if relative > _CAUTION else ""
    photons = number(noise["equivalent_photons_per_pixel"])
    text = Markup(
        "{}The rendering is as noisy as {} photons per pixel ({} of a pixel’s light, median over "
        "pixels). {}"
    )
    kind = "warn" if relative > _CAUTION else "note"
    return paragraph(text.format(caution, photons, percent(relative), consequence), kind)


def rendering_errors(record: Record) -> Iterator[tuple[str, str]]:
    """Yield errors of the rendered light, by name."""
    noise = record.get("monte_carlo") or {}
    if noise.get("median_relative"):
        yield "error (RMS) over the mean light", percent(noise["rms_over_mean"])
    if surface := noise.get("surface"):
        yield "the same, of pixels without sky", percent(surface["rms"])
        yield "relative error of 95 % of the pixels", f"{percent(surface['p95'])} or less"
        yield "share of the gradient energy due to it", percent(surface["gradient"])
        yield "fixed error of baked light (RMS)", percent(surface["standing"])
        share = percent(surface["standing_gradient"])
        yield "share of the gradient energy due to the fixed error", share
    if sky := noise.get("sky"):
        yield "error of the sky (RMS) over its light", percent(sky["rms"])
    if shares := record.get("light_left_out"):
        yield "truncation bias of path depth, worst band", percent(max(shares))


def key(report: Report) -> Markup:
    """Return the markers of all methods in their colors, with their names."""
    line = Markup('<li><span style="color:{}" aria-hidden="true">{}</span> <b>{}</b> {}</li>')
    lines = []
    for name in report.settings.methods:
        style = method_style(name)
        color, glyph = themed(style["color"]), GLYPHS[style["marker"]]
        lines.append(line.format(color, glyph, name, METHODS[name].label))
    return Markup('<ul class="key">{}</ul>').format(Markup("").join(lines))
