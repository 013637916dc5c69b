"""Why natural thresholds differ between pictures: what a photon tells of motion.

The Poisson bound (`flow.translation_bound`) sums (∂λ/∂x)²/λ over a block. Per pixel, at one photon
per pixel, that is a number of the picture alone. Its median over the blocks tells what all methods
need of a picture, contrast does not: a few bright spots raise it and help few blocks.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import EngFormatter, NullFormatter
from numpy.typing import NDArray

from megalopta.chapter4_sweeps import PHOTOGRAPHED, SWEEPS, in_form
from megalopta.engine import Results
from megalopta.figure import Figure
from megalopta.figures_chapter4_table import PRINTED, SIZE
from megalopta.figures_sweep import threshold_of
from megalopta.flow.blocks import block_grid
from megalopta.flow.stimulus import MovingTemplate
from megalopta.flow.translation_bound import translation_information
from megalopta.planned import Planned, Templates
from megalopta.plot_style import method_style
from megalopta.sweep import Point
from megalopta.trial import PanoramaTemplate, Template, Trial

_SOURCES = (PHOTOGRAPHED, SWEEPS["fig-4.11"])
_COLUMNS_APART = 25


class Seen(NamedTuple):
    """What one method needs of one picture."""

    method: str
    picture: str
    coding: str
    information: float
    """px⁻² per photon"""

    photons: float
    """Per frame, at the velocity where they are fewest"""


def median_information(template: NDArray[np.float64]) -> float:
    """Return the information on motion along x of the median block of 60 × 60 frames.

    Parameters
    ----------
    template : (251, m)
        A full turn.

    Returns
    -------
    float
        px⁻² per pixel, at one photon per pixel.
    """
    grid = block_grid((SIZE, SIZE))
    turning = MovingTemplate(template, _COLUMNS_APART, SIZE)
    frames = turning.light(0, template.shape[1] // _COLUMNS_APART) * SIZE**2
    along_x = [translation_information(frame, grid)[1:-1, 1:-1, 0, 0] for frame in frames]
    return float(np.median(along_x)) / grid.block_px**2


def implied_information(seen: Sequence[Seen], printed: float) -> float:
    """Return the information of the picture of which a method would need the printed photons.

    Thresholds are inverse to it, at the (geometric) mean of the pictures given.
    """
    return (
        float(np.exp(np.mean([np.log(each.information * each.photons) for each in seen]))) / printed
    )


def _points(is_quick: bool) -> list[Point]:
    sweeps = (in_form(sweep, is_quick) for sweep in _SOURCES)
    return [point for sweep in sweeps for point in sweep.points() if point.size == SIZE]


def _trials(is_quick: bool) -> list[Trial]:
    return [point.trial for point in _points(is_quick)]


def _least(results: Results, trials: list[Trial], method: str) -> float:
    """Return the fewest photons at any velocity."""
    found = [threshold_of(results, trial, method, "literal", 2).flux for trial in trials]
    return min(flux for flux in found if flux is not None)


def _figure(is_quick: bool, results: Results, templates: Templates) -> Figure:
    pictures: dict[Template, list[Trial]] = {}
    for trial in _trials(is_quick):
        pictures.setdefault(trial.template, []).append(trial)
    seen = [
        Seen(method, *_named(template), median_information(templates[template]), least)
        for template, trials in pictures.items()
        for method in PRINTED
        for least in [_least(results, trials, method)]
    ]
    stars = {
        method: implied_information(
            [each for each in seen if (each.method, each.coding) == (method, "srgb")], printed
        )
        for method, (_, printed) in PRINTED.items()
    }
    spans = ", ".join(
        f"{min(values):.2g} to {max(values):.2g} in {text}"
        for coding, text in (("srgb", "gray values"), ("linear", "light"))
        for values in [[each.information for each in seen if each.coding == coding]]
    )
    asked = ", ".join(f"{value:.2g} ({method})" for method, value in stars.items())
    return Figure(
        name="natural-information",
        title="Natural scenes: photons needed over the information in a picture",
        caption=(
            f"{SIZE} × {SIZE} px, least of all velocities. Information on motion along x that a "
            "photon brings to the median block: Σ(∂λ/∂x)²/λ per pixel, at one photon per pixel; "
            f"{spans}. Lines: inverse to it, through the gray values. Stars: the printed "
            f"thresholds, where our lines meet them. They ask for pictures of {asked}."
        ),
        draw=lambda canvas: _draw(canvas, seen, stars),
        columns=("method", "picture", "coding", "information_per_photon", "photons_per_frame"),
        rows=(
            *seen,
            *(
                (method, "dissertation", "", stars[method], printed)
                for method, (_, printed) in PRINTED.items()
            ),
        ),
        height_in=4.2,
    )


def _named(template: Template) -> tuple[str, str]:
    assert isinstance(template, PanoramaTemplate)
    return template.name, template.coding


def _draw(canvas: Canvas, seen: Sequence[Seen], stars: Mapping[str, float]) -> None:
    axes = canvas.subplots()
    right = max(each.information for each in seen)
    for method, (_, printed) in PRINTED.items():
        style = method_style(method) | {"linestyle": "none"}
        for coding, face, label in (("srgb", style["color"], method), ("linear", "none", None)):
            points = [each for each in seen if (each.method, each.coding) == (method, coding)]
            axes.plot(
                [each.information for each in points],
                [each.photons for each in points],
                **style,
                markerfacecolor=face,
                label=label,
            )
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
    axes.set_xlabel("Information of the median block (px$^{-2}$ per photon)")
    axes.set_ylabel("Least $N_{2b}$ (photons per frame)")
    canvas.legend(loc="outside right center")


NATURAL_INFORMATION = Planned(_trials, _figure)
