"""Why natural thresholds differ between pictures: what a photon tells of motion.

The Poisson bound (`flow.translation_bound`) sums J = (∂λ/∂x)²/λ over a block. Per pixel, at one
photon per pixel, that is a number of the picture, and of the dark counts beside the photons. The
variances 1/J that the bound leaves are averaged over the blocks: one over their mean tells what a
method needs of a picture better than contrast does, which a few bright spots raise that help few
blocks, and better than the median block.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import EngFormatter, NullFormatter

from megalopta.benchmark.panorama_recipes import ROWS
from megalopta.benchmark.runner import Results
from megalopta.benchmark.templates import PanoramaTemplate, Template
from megalopta.benchmark.trial import Trial
from megalopta.core.arrays import Floats
from megalopta.flow.detectors.blocks import block_grid
from megalopta.flow.metrics.translation_bound import fisher_information
from megalopta.flow.stimuli.moving_template import MovingTemplate
from megalopta.plotting.picture import Figure, borne_out
from megalopta.plotting.style import method_style
from megalopta.reproduction.chapter4_sweeps import PHOTOGRAPHED, SWEEPS, in_form
from megalopta.reproduction.chapter4_table import PRINTED, SIZE
from megalopta.reproduction.recipe import FigureRecipe, Run, Templates
from megalopta.reproduction.thresholds import threshold_of

_SOURCES = (PHOTOGRAPHED, SWEEPS["fig-4.11"])
_COLUMNS_APART = 25
_ALIKE = ("BM", "NDM", "NDS")


class Seen(NamedTuple):
    """What one method needs of one picture."""

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


def implied_information(seen: Sequence[Seen], printed: float) -> float:
    """Return the information of the picture of which a method would need the printed photons.

    Thresholds are inverse to it, at the (geometric) mean of the pictures given.
    """
    products = [each.information * each.photons for each in seen]
    return float(np.exp(np.mean(np.log(products)))) / printed


def _trials(is_quick: bool) -> list[Trial]:
    sweeps = (in_form(sweep, is_quick) for sweep in _SOURCES)
    return [point.trial for sweep in sweeps for point in sweep.points if point.size == SIZE]


def needed_of(method: str, trials: Sequence[Trial], results: Results, templates: Templates) -> Seen:
    """Return what a method needs of the picture that these trials share."""
    template = trials[0].template
    assert isinstance(template, PanoramaTemplate)
    found = [threshold_of(results, trial, method, "literal", 2).flux for trial in trials]
    photons = min((flux for flux in found if flux is not None), default=math.nan)
    information = math.nan
    if photons > 0:
        dark_counts = trials[0].search.dark_counts * ROWS**2
        information = information_per_photon(templates[template], dark_counts / photons)
    return Seen(method, template.name, template.coding, information, photons)


def inverse_to_information(seen: Sequence[Seen]) -> str | None:
    """Say that information tells photons to a factor of two, if it does so better than nothing."""
    spreads, ranges = [], []
    for method in PRINTED:
        gray = _of(seen, method, "srgb")
        spreads.append(_quotient([each.information * each.photons for each in gray]))
        ranges.append(_quotient([each.photons for each in gray]))
    alike = zip(spreads, ranges, strict=True)
    if not all(spread < 2 and spread < 0.75 * range_ for spread, range_ in alike):
        return None
    return (
        f"In gray values photons vary by factors of {min(ranges):.1f} to {max(ranges):.1f} from "
        "picture to picture, their product with the information only by "
        f"{min(spreads):.1f} to {max(spreads):.1f}."
    )


def like_the_open_forest(seen: Sequence[Seen], stars: Mapping[str, float]) -> str | None:
    """Say that the printed thresholds are those of a picture such as the forest open, if so."""
    shares = [
        stars[each.method] / each.information
        for each in seen
        if (each.picture, each.coding) == ("open", "srgb") and each.method in _ALIKE
    ]
    if not shares or not all(0.5 < share < 2 for share in shares):
        return None
    return (
        "The printed thresholds of BM, NDM and NDS are those of a picture with "
        f"{min(shares):.1f} to {max(shares):.1f} times the information of the forest open."
    )


def apart(stars: Mapping[str, float]) -> str | None:
    """Say that the printed threshold of IIA asks for another picture, if it does."""
    share = stars["IIA"] / math.exp(np.mean([math.log(stars[method]) for method in _ALIKE]))
    if not share < 0.5:
        return None
    return (
        f"The printed threshold of IIA asks for a picture with {share:.2g} of the information that "
        "those of BM, NDM and NDS ask for."
    )


def _of(seen: Sequence[Seen], method: str, coding: str) -> list[Seen]:
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
    found = borne_out(inverse_to_information(seen), like_the_open_forest(seen, stars), apart(stars))
    printed = [
        Seen(method, "dissertation", "", stars[method], natural)
        for method, (_, natural) in PRINTED.items()
    ]
    columns = ("method", "picture", "coding", "information_per_photon", "photons_per_frame")
    return Figure(
        title="Photons needed over the information in a natural picture",
        caption=(
            f"Points are the least photons per frame of {SIZE} × {SIZE} px, of all velocities, "
            "over the information on motion along x that a photon brings: the harmonic mean over "
            "the blocks of (∂λ/∂x)²/λ at one photon per pixel, with the dark counts beside it. "
            "Lines are inverse to it, through the gray values, and stars stand where they meet the "
            f"printed thresholds. {' '.join(found[:1])}"
        ).strip(),
        draw=lambda canvas: _draw(canvas, seen, stars),
        numbers=dict(zip(columns, zip(*seen, *printed, strict=True), strict=True)),
        height_in=4.2,
        findings=found,
    )


def _draw(canvas: Canvas, seen: Sequence[Seen], stars: Mapping[str, float]) -> None:
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
    for marker, face, text in (
        ("o", "black", "forests, gray values"),
        ("o", "none", "forests, light"),
        ("*", "black", "dissertation"),
    ):
        axes.plot([], [], marker, color="black", markerfacecolor=face, label=text)
    axes.set(xscale="log", yscale="log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_major_formatter(EngFormatter(sep=""))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("Information on motion (px$^{-2}$ per photon)")
    axes.set_ylabel("Least $N_{2b}$ (photons per frame)")
    canvas.legend(loc="outside right center")


RECIPES = (FigureRecipe("natural-information", _figure, _trials),)
