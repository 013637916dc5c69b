"""Table 4.1: the fewest photons with which each method reaches two bits, beside the printed."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from matplotlib.figure import Figure as Canvas

from megalopta.benchmark.runner import Results
from megalopta.benchmark.sweep import Sweep
from megalopta.benchmark.trial import Trial
from megalopta.flow.metrics.photon_threshold import format_flux
from megalopta.flow.metrics.response_error import METRICS, Metric
from megalopta.plotting.picture import (
    Cell,
    Figure,
    borne_out,
    columns_of,
)
from megalopta.plotting.style import draw_table
from megalopta.reproduction.chapter4_findings import division_sentence, interpolation_at_one_pixel
from megalopta.reproduction.chapter4_page import TABLE, write_page
from megalopta.reproduction.chapter4_sweeps import PHOTOGRAPHED, SWEEPS, in_form
from megalopta.reproduction.recipe import FigureRecipe, Run
from megalopta.reproduction.thresholds import MeanThreshold, or_nan, sweep_curve

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

    threshold: MeanThreshold
    where: str


def best(results: Results, kind: str, method: str, metric: Metric, is_quick: bool = False) -> Best:
    """Return the fewest photons that a method needs in any experiment of a kind."""
    found = [Best(MeanThreshold(math.inf, None, None, ""), "")]
    for source in _SOURCES[kind]:
        sweep = in_form(source, is_quick)
        parameter = {"template.cycles_per_frame": "f", "velocity_px": "v"}[sweep.vary]
        blur = ", blurred" if sweep.trial.blurred else ""
        for value, threshold in sweep_curve(sweep, results, SIZE, method, metric):
            found.append(Best(threshold, f"{parameter} = {value}{blur}"))
    return min(
        (each for each in found if each.threshold.flux > 0), key=lambda each: each.threshold.flux
    )


def _trials(is_quick: bool) -> list[Trial]:
    sweeps = [in_form(sweep, is_quick) for sources in _SOURCES.values() for sweep in sources]
    return [point.trial for sweep in sweeps for point in sweep.points if point.size == SIZE]


def _figure(run: Run) -> Figure:
    rows = [
        _row(run, kind, method, metric)
        for kind in _SOURCES
        for method in PRINTED
        for metric in METRICS
    ]
    photographed = in_form(PHOTOGRAPHED, run.is_quick)

    def draw(canvas: Canvas) -> None:
        head = ["", "Thesis", "Ours", "Ratio", "95 % or forests", "Found at", "Σ|Δ|/Σ|R|"]
        lines = [_line(*pair) for pair in zip(rows[::2], rows[1::2], strict=True)]
        draw_table(canvas, head, lines, [1.5, 0.9, 0.9, 0.7, 1.6, 1.6, 1.1])

    return Figure(
        title="Table 4.1: fewest photons per frame for two bits, 60 × 60 px",
        caption=NOTE,
        draw=draw,
        numbers=columns_of(rows),
        height_in=5.0,
        findings=borne_out(
            fewer_in_light(rows),
            division_of_natural(rows),
            interpolation_at_one_pixel(photographed, run.results),
        ),
    )


def _row(run: Run, kind: str, method: str, metric: Metric) -> dict[str, Cell]:
    threshold, where = best(run.results, kind, method, metric, run.is_quick)
    thesis = PRINTED[method][kind != "synthetic"]
    return {
        "method": method,
        "images": kind,
        "metric": metric,
        "thesis_photons_per_frame": thesis,
        "photons_per_frame": threshold.flux,
        "low": or_nan(threshold.low),
        "high": or_nan(threshold.high),
        "interval": threshold.interval,
        "ratio": threshold.flux / thesis,
        "found_at": where,
    }


def _line(literal: Mapping[str, Any], ratio: Mapping[str, Any]) -> list[str]:
    return [
        f"{literal['method']}, {literal['images']}",
        format_flux(literal["thesis_photons_per_frame"]),
        format_flux(literal["photons_per_frame"]),
        f"{literal['ratio']:.2f}",
        literal["interval"],
        literal["found_at"],
        format_flux(ratio["photons_per_frame"]),
    ]


def fewer_in_light(rows: Sequence[Mapping[str, Any]]) -> str | None:
    """Say that light needs fewer photons than gray values, if it does with every method."""
    light, gray = (_fluxes(rows, images, "literal") for images in ("natural", "photo"))
    if not all(light[method] < gray[method] for method in PRINTED):
        return None
    return (
        "Every method needs fewer photons of the forests in light than of their gray values, which "
        "have less contrast."
    )


def division_of_natural(rows: Sequence[Mapping[str, Any]]) -> str | None:
    """Say how much more EMD needs by Eq. 4.5 on natural scenes, if it is much."""
    by_quotients, by_means = (_fluxes(rows, "natural", each)["EMD"] for each in METRICS)
    return division_sentence(by_quotients / by_means)


def _fluxes(rows: Sequence[Mapping[str, Any]], images: str, metric: Metric) -> dict[str, float]:
    return {
        row["method"]: row["photons_per_frame"]
        for row in rows
        if (row["images"], row["metric"]) == (images, metric)
    }


RECIPES = (FigureRecipe(TABLE, _figure, _trials, write_page),)
