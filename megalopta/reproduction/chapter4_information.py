"""Why natural thresholds differ between pictures: what a photon tells of motion.

The Poisson bound (`flow.translation_bound`) sums J = (∂λ/∂x)²/λ over a block. Per pixel, at one
photon per pixel, that is a number of the picture, and of the dark counts beside the photons. The
variances 1/J that the bound leaves are averaged over the blocks: one over their mean tells what a
method needs of a picture better than contrast does, which a few bright spots raise that help few
blocks, and better than the median block.
"""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure as Canvas

from megalopta.benchmark.panoramas import ROWS
from megalopta.benchmark.runner import Results
from megalopta.benchmark.trial import PanoramaTemplate, Template, Trial
from megalopta.core.arrays import Floats
from megalopta.flow.detectors.blocks import block_grid
from megalopta.flow.metrics.translation_bound import fisher_information
from megalopta.flow.stimuli.moving_template import MovingTemplate
from megalopta.plotting.picture import Figure
from megalopta.plotting.style import BLACK, draw_key, log_decades, method_style
from megalopta.reproduction.chapter4_curves import PHOTOGRAPHED, SWEEPS, in_form, span
from megalopta.reproduction.chapter4_table import PRINTED, SIZE
from megalopta.reproduction.drawing import FigureRecipe, Run, Templates
from megalopta.reproduction.sweep_figure import threshold_of

_SOURCES = (PHOTOGRAPHED, SWEEPS["fig-4.11"])
_COLUMNS_APART = 25
_ALIKE = ("BM", "NDM", "NDS")
_CAPTION = (
    f"Points are the least photons per frame of {SIZE} × {SIZE} px, of all velocities, over the "
    "information on motion along x that a photon brings: the harmonic mean over the blocks of "
    "(∂λ/∂x)²/λ at one photon per pixel, with the dark counts beside it. Lines are inverse to it, "
    "through the gray values, and stars stand where they meet the printed thresholds."
)
_KEY = (
    ("o", BLACK, "forests, gray values"),
    ("o", "none", "forests, light"),
    ("*", BLACK, "dissertation"),
)


class Need(NamedTuple):
    """Photons that one method needs of one picture."""

    method: str
    picture: str
    coding: str
    information: float
    """px⁻² per photon"""

    photons: float
    """Per frame, at the velocity where they are fewest"""


def information_per_photon(template: Floats, dark_share: float = 0.0) -> float:
    """Return the information on motion along x in 60 × 60 frames, the harmonic mean of the blocks.

    In px⁻² per pixel at one photon per pixel, of a full turn (251, m) with so many dark counts per
    photon; 0 when a block has no gradient.
    """
    grid = block_grid((SIZE, SIZE))
    turning = MovingTemplate(template, _COLUMNS_APART, SIZE)
    frames = turning.light(0, template.shape[1] // _COLUMNS_APART) * SIZE**2 + dark_share
    along_x = [fisher_information(frame, grid)[1:-1, 1:-1, 0, 0] for frame in frames]
    with np.errstate(divide="ignore"):
        return float(1 / np.mean(1 / np.array(along_x))) / grid.block_px**2


def implied_information(seen: Sequence[Need], printed: float) -> float:
    """Return the information of the picture of which a method would need the printed photons.

    Thresholds are inverse to it, at the (geometric) mean of the pictures given.
    """
    products = [each.information * each.photons for each in seen]
    return float(np.exp(np.mean(np.log(products)))) / printed


def _trials(is_quick: bool) -> list[Trial]:
    sweeps = (in_form(sweep, is_quick) for sweep in _SOURCES)
    return [point.trial for sweep in sweeps for point in sweep.points if point.size == SIZE]


def needed_of(method: str, trials: Sequence[Trial], results: Results, templates: Templates) -> Need:
    """Return what a method needs of the picture that these trials share."""
    template = trials[0].template
    assert isinstance(template, PanoramaTemplate)
    found = [threshold_of(results, trial, method, "literal", 2).flux for trial in trials]
    photons = min((flux for flux in found if flux is not None), default=math.nan)
    information = math.nan
    if photons > 0:
        dark_counts = trials[0].search.dark_counts * ROWS**2
        information = information_per_photon(templates[template], dark_counts / photons)
    return Need(method, template.name, template.coding, information, photons)


def explained(seen: Sequence[Need], stars: Mapping[str, float]) -> dict[str, tuple[str, str]]:
    """Return how photons vary with pictures, and what pictures the printed thresholds ask for."""
    gray = {method: _of(seen, method, "srgb") for method in PRINTED}
    ranges = [_quotient([each.photons for each in own]) for own in gray.values()]
    spreads = [
        _quotient([each.information * each.photons for each in own]) for own in gray.values()
    ]
    shares = [
        stars[method] / each.information
        for method in _ALIKE
        for each in gray[method]
        if each.picture == "open"
    ]
    iia = stars["IIA"] / math.exp(np.mean([math.log(stars[method]) for method in _ALIKE]))
    found = {
        "Photons, most over least picture (gray values)": span(ranges),
        "Photons times information, the same": span(spreads),
        "Information asked by BM, NDM, NDS over forest open": span(shares),
        "Information asked by IIA over theirs": span([iia]),
    }
    return {what: (text, "—") for what, text in found.items()}


def _of(seen: Sequence[Need], method: str, coding: str) -> list[Need]:
    return [each for each in seen if (each.method, each.coding) == (method, coding)]


def _quotient(values: Sequence[float]) -> float:
    return max(values) / min(values) if values else math.nan


def _figure(run: Run) -> Figure:
    pictures: dict[Template, list[Trial]] = {}
    for trial in _trials(run.is_quick):
        pictures.setdefault(trial.template, []).append(trial)
    seen = [
        needed_of(method, trials, run.results, run.templates)
        for trials in pictures.values()
        for method in PRINTED
    ]
    stars = {
        method: implied_information(_of(seen, method, "srgb"), printed)
        for method, (_, printed) in PRINTED.items()
    }
    printed = [
        Need(method, "dissertation", "", stars[method], natural)
        for method, (_, natural) in PRINTED.items()
    ]
    columns = ("method", "picture", "coding", "information_per_photon", "photons_per_frame")
    return Figure(
        title="Photons needed over the information in a natural picture",
        caption=_CAPTION,
        draw=partial(_draw, seen=seen, stars=stars),
        numbers=dict(zip(columns, zip(*seen, *printed, strict=True), strict=True)),
        height_in=4.2,
        printed=explained(seen, stars),
    )


def _draw(canvas: Canvas, seen: Sequence[Need], stars: Mapping[str, float]) -> None:
    axes = canvas.subplots()
    right = max(each.information for each in seen)
    for method, (_, printed) in PRINTED.items():
        style = method_style(method) | {"linestyle": "none"}
        for coding, face, label in (("srgb", style["color"], method), ("linear", "none", None)):
            *_, information, photons = zip(*_of(seen, method, coding), strict=True)
            axes.plot(information, photons, **style, markerfacecolor=face, label=label)
        ends = np.array([stars[method], right])
        axes.plot(ends, printed * ends[0] / ends, color=style["color"], linewidth=1)
        axes.plot(ends[0], printed, "*", color=style["color"], markersize=14)
    draw_key(axes, _KEY)
    log_decades(axes, "x", "{x:g}")
    log_decades(axes, "y")
    axes.set_xlabel("Information on motion (px$^{-2}$ per photon)")
    axes.set_ylabel("Least $N_{2b}$ (photons per frame)")
    canvas.legend(loc="outside right center")


RECIPES = (FigureRecipe("natural-information", _figure, _trials),)
