"""Table 4.1: the fewest photons with which each method reaches two bits, beside the printed."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from matplotlib.figure import Figure as Canvas

from megalopta.experiments import PHOTOGRAPHED, SWEEPS, Results, Sweep, Trial, in_form
from megalopta.figures import (
    Cell,
    Figure,
    FigureRecipe,
    Needed,
    Run,
    bound,
    draw_table,
    sweep_curve,
)
from megalopta.figures.chapter4.findings import division_sentence, interpolation_at_one_pixel
from megalopta.figures.chapter4.page import TABLE, write_page
from megalopta.flow.metrics import METRICS, Metric, format_flux

PRINTED: Mapping[str, tuple[float, float]] = {
    "BM": (83e3, 156e3),
    "IIA": (68e3, 739e3),
    "EMD": (813e3, 154e6),
    "NDM": (681e3, 4.38e6),
    "NDS": (228e3, 1.02e6),
}
"""Photons per frame on synthetic and natural images."""

NOTE = (
    "Each line is the least N_2b, in photons per frame of 60 × 60 px, of all spatial frequencies f "
    "and velocities v (synthetic), or of all velocities with and without motion blur as the mean "
    "of the forests (natural; photo: in gray values). Brackets hold the 95 % interval of the one "
    "experiment named, which does not hold for the least of many, or the least and the most of "
    "the forests. Σ|Δ|/Σ|R| is N_2b by the quotient of means, which does not divide by responses "
    "near zero."
)
SIZE = 60
_SOURCES: Mapping[str, tuple[Sweep, ...]] = {
    "synthetic": (SWEEPS["fig-4.5"], SWEEPS["fig-4.8"]),
    "natural": (SWEEPS["fig-4.11"], SWEEPS["fig-4.12"]),
    "photo": (PHOTOGRAPHED,),
}


class Best(NamedTuple):
    """The least N_2b of some sweeps, and where it was found."""

    needed: Needed
    where: str


def best(results: Results, kind: str, method: str, metric: Metric, is_quick: bool = False) -> Best:
    """Return the fewest photons that a method needs in any experiment of a kind."""
    found = [Best(Needed(math.inf, None, None, ""), "")]
    for source in _SOURCES[kind]:
        sweep = in_form(source, is_quick)
        parameter = {"template.cycles_per_frame": "f", "velocity_px": "v"}[sweep.vary]
        blur = ", blurred" if sweep.trial.blurred else ""
        for value, needed in sweep_curve(sweep, results, SIZE, method, metric):
            found.append(Best(needed, f"{parameter} = {value}{blur}"))
    return min((each for each in found if each.needed.flux > 0), key=lambda each: each.needed.flux)


def _trials(is_quick: bool) -> list[Trial]:
    sweeps = [in_form(sweep, is_quick) for sources in _SOURCES.values() for sweep in sources]
    return [point.trial for sweep in sweeps for point in sweep.points if point.size == SIZE]


def _figure(run: Run) -> Figure:
    rows: list[tuple[Cell, ...]] = []
    lines: list[list[str]] = []
    for kind in _SOURCES:
        for method, printed in PRINTED.items():
            literal, ratio = (
                best(run.results, kind, method, metric, run.is_quick)
                for metric in ("literal", "ratio")
            )
            thesis = printed[kind != "synthetic"]
            rows += [
                (method, kind, metric, thesis, *_numbers(found, thesis))
                for metric, found in (("literal", literal), ("ratio", ratio))
            ]
            flux = literal.needed.flux
            lines.append(
                [
                    f"{method}, {kind}",
                    format_flux(thesis),
                    format_flux(flux),
                    f"{flux / thesis:.2f}",
                    literal.needed.interval,
                    literal.where,
                    format_flux(ratio.needed.flux),
                ]
            )

    said = (
        fewer_in_light(rows),
        division_of_natural(rows),
        interpolation_at_one_pixel(in_form(PHOTOGRAPHED, run.is_quick), run.results),
    )

    def draw(canvas: Canvas) -> None:
        head = ["", "Thesis", "Ours", "Ratio", "95 % or forests", "Found at", "Σ|Δ|/Σ|R|"]
        draw_table(canvas, head, lines, [1.5, 0.9, 0.9, 0.7, 1.6, 1.6, 1.1])

    return Figure(
        name=TABLE,
        title="Table 4.1: fewest photons per frame for two bits, 60 × 60 px",
        caption=NOTE,
        draw=draw,
        columns=(
            "method",
            "images",
            "metric",
            "thesis_photons_per_frame",
            "photons_per_frame",
            "low",
            "high",
            "interval",
            "ratio",
            "found_at",
        ),
        rows=tuple(rows),
        height_in=5.0,
        findings=tuple(sentence for sentence in said if sentence),
    )


def fewer_in_light(rows: Sequence[Sequence[Cell]]) -> str | None:
    """Say that light needs fewer photons than gray values, if it does with every method."""
    light, gray = (_fluxes(rows, images, "literal") for images in ("natural", "photo"))
    if not all(light[method] < gray[method] for method in PRINTED):
        return None
    return (
        "Every method needs fewer photons of the forests in light than of their gray values, which "
        "have less contrast."
    )


def division_of_natural(rows: Sequence[Sequence[Cell]]) -> str | None:
    """Say how much more EMD needs by Eq. 4.5 on natural scenes, if it is much."""
    by_quotients, by_means = (_fluxes(rows, "natural", each)["EMD"] for each in METRICS)
    return division_sentence(by_quotients / by_means)


def _fluxes(rows: Sequence[Sequence[Cell]], images: str, metric: Metric) -> dict[str, float]:
    chosen = [row for row in rows if (row[1], row[2]) == (images, metric)]
    return {str(row[0]): float(row[4]) for row in chosen}


def _numbers(found: Best, thesis: float) -> tuple[Cell, ...]:
    needed = found.needed
    bounds = bound(needed.low), bound(needed.high)
    return needed.flux, *bounds, needed.interval, needed.flux / thesis, found.where


RECIPES = (FigureRecipe(TABLE, _figure, _trials, write_page),)
