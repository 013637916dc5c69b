"""Table 4.1, the fewest photons for two bits, and the page of Chapter 4."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from megalopta.benchmark.runner import Results
from megalopta.benchmark.trial import Sweep, Trial
from megalopta.flow.metrics.photon_threshold import format_flux
from megalopta.flow.metrics.response_error import METRICS, Metric
from megalopta.report.sections import Section, block, definitions, image, write_sections
from megalopta.reproduction.chapter4_curves import (
    PHOTOGRAPHED,
    SWEEPS,
    in_form,
    interpolation_beside_one_pixel,
    span,
)
from megalopta.reproduction.picture import Cell, Figure, columns_of, draw_table
from megalopta.reproduction.sweep_figure import MeanThreshold, or_nan, sweep_curve

PRINTED: Mapping[str, tuple[float, float]] = {
    "BM": (83e3, 156e3),
    "IIA": (68e3, 739e3),
    "EMD": (813e3, 154e6),
    "NDM": (681e3, 4.38e6),
    "NDS": (228e3, 1.02e6),
}
"""Photons per frame on synthetic and natural images."""

NOTE = (
    "Each line is the least N_2b, in photons per frame of 60 × 60 px, over all spatial frequencies "
    "f and velocities v (synthetic), or over all velocities with and without motion blur, mean of "
    "the forests (natural; photo: in gray values). Brackets: 95 % CI of the named experiment, "
    "which is not one of the least of many, or range over the forests. Σ|Δ|/Σ|R|: N_2b by the "
    "quotient of means, which does not divide by responses near zero."
)
SIZE = 60
_HEAD = ("", "Thesis", "Ours", "Ratio", "95 % or forests", "Found at", "Σ|Δ|/Σ|R|")
_WIDTHS = (1.5, 0.9, 0.9, 0.7, 1.6, 1.6, 1.1)
TABLE = "table-4.1"
_TITLE = "Photons that motion detectors need"
_SUMMARY = (
    "Chapter 4 of the dissertation, measured again: N_2b, the photons per frame at which the error "
    "by photon noise falls to 25 %."
)
_DIFFERENT = {
    "The numbers to the digit": "The text does not state how filters are discretized, whether NDM "
    "is rectified, which blocks and frames are scored, and how a curve is interpolated. These "
    "choices were made afterwards, from about fifteen variants; where numbers agree, they are "
    "consistent with the dissertation, not those of its program.",
    "The natural column": "The photographs came from the web and are not published. Forests "
    "rendered by this project replace them, with the same fields of view; the rows “photo” use "
    "their gray values. Thresholds depend on the information on motion per photon.",
    "Single velocities of IIA": "Interpolation between whole pixels is nearly exact only where the "
    "shift is nearly one pixel of the resized frames.",
    "EMD on natural scenes": "Eq. 4.5 divides by the ideal response of every pixel, and "
    "EMD's passes through zero: the mean has no limit. The quotient of means in the last column "
    "does not divide by zero.",
    "Points of BM without N_2b": "At low velocities BM gives zero in most blocks of the clean "
    "frames, and its error is 0/0.",
}
_SOURCES: Mapping[str, tuple[Sweep, ...]] = {
    "synthetic": (SWEEPS["fig-4.5"], SWEEPS["fig-4.8"]),
    "natural": (SWEEPS["fig-4.11"], SWEEPS["fig-4.12"]),
    "photo": (PHOTOGRAPHED,),
}


class Least(NamedTuple):
    """The least N_2b of some sweeps, and its parameters."""

    threshold: MeanThreshold
    where: str


def least(
    results: Results, kind: str, method: str, metric: Metric, is_quick: bool = False
) -> Least:
    """Return the fewest photons that a method needs in any experiment of a kind."""
    found = [Least(MeanThreshold(math.inf, None, None, ""), "")]
    for source in _SOURCES[kind]:
        sweep = in_form(source, is_quick)
        parameter = {"template.cycles_per_frame": "f", "velocity_px": "v"}[sweep.vary]
        blur = ", blurred" if sweep.trial.blurred else ""
        for value, threshold in sweep_curve(sweep, results, SIZE, method, metric):
            found.append(Least(threshold, f"{parameter} = {value}{blur}"))
    return min(
        (each for each in found if each.threshold.flux > 0), key=lambda each: each.threshold.flux
    )


def table_trials(is_quick: bool) -> list[Trial]:
    """Return the trials of Table 4.1."""
    sweeps = [in_form(sweep, is_quick) for sources in _SOURCES.values() for sweep in sources]
    return [point.trial for sweep in sweeps for point in sweep.points if point.size == SIZE]


def table_figure(results: Results, is_quick: bool) -> Figure:
    """Return Table 4.1."""
    rows = [
        _row(results, is_quick, kind, method, metric)
        for kind in _SOURCES
        for method in PRINTED
        for metric in METRICS
    ]
    light, gray = (_fluxes(rows, images, "literal") for images in ("natural", "photo"))
    by_means = _fluxes(rows, "natural", "ratio")["EMD"]
    photographed = in_form(PHOTOGRAPHED, is_quick)
    beside = interpolation_beside_one_pixel(photographed, results)
    printed = {
        "Forests in light over their gray values": span(light[each] / gray[each] for each in light),
        "EMD by Eq. 4.5 over quotient of means": span([light["EMD"] / by_means]),
        "IIA, median velocity over v = 4, gray values": span(beside),
    }
    return Figure(
        name=TABLE,
        title="Table 4.1: fewest photons per frame for two bits, 60 × 60 px",
        caption=NOTE,
        draw=partial(draw_table, head=_HEAD, rows=_lines(rows), widths=_WIDTHS),
        numbers=columns_of(rows),
        height_in=5.0,
        printed={name: (text, "—") for name, text in printed.items()},
    )


def _row(
    results: Results, is_quick: bool, kind: str, method: str, metric: Metric
) -> dict[str, Cell]:
    threshold, where = least(results, kind, method, metric, is_quick)
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


def _lines(rows: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    return [_line(*pair) for pair in zip(rows[::2], rows[1::2], strict=True)]


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


def _fluxes(rows: Sequence[Mapping[str, Any]], images: str, metric: Metric) -> dict[str, float]:
    return {
        row["method"]: row["photons_per_frame"]
        for row in rows
        if (row["images"], row["metric"]) == (images, metric)
    }


def write_page(out: Path, figures: Sequence[Figure]) -> Path:
    """Write chapter-4.html next to the pictures of some figures, one of them Table 4.1."""
    (table,) = (figure for figure in figures if figure.name == TABLE)
    rows = [dict(zip(table.columns, row, strict=True)) for row in table.rows]
    compared = (
        (f"{each.name}: {what}", *texts) for each in figures for what, texts in each.printed.items()
    )
    pictures = (
        image(f"{each.name}.svg", f"{each.title}. {each.caption}")
        for each in figures
        if each.name != TABLE
    )
    sections = [
        Section("Table 4.1", NOTE, _HEAD, tuple(map(tuple, _lines(rows)))),
        Section("This run", "", ("", "ours", "printed"), tuple(compared)),
        Section("Differences, and their reasons", body=definitions("words", _DIFFERENT.items())),
        Section("Figures", body=block("", *pictures)),
    ]
    quick = " Quick form: fewer values, sizes and forests than in the dissertation."
    summary = _SUMMARY + (quick if table.details.get("quick") else "")
    return write_sections(out / "chapter-4.html", _TITLE, summary, sections)
