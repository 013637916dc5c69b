"""Chapter 4 of the dissertation with the models of this package: its sweeps and Table 4.1.

The sweeps are `sweeps/fig-4.5.yaml` to `fig-4.13.yaml`. Pooling levels are those of text or
captions. Bytes depend only on the versions of this package, of NumPy and of matplotlib.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd

from megalopta.benchmark.table import records
from megalopta.benchmark.trial import Results, Sweep, Trial, load_sweep
from megalopta.core.errors import UserError
from megalopta.core.folders import ensure_directory
from megalopta.core.progress import progress
from megalopta.core.quantities import UNDEFINED, number
from megalopta.flow.metrics.response_error import METRICS
from megalopta.report import sections
from megalopta.reproduction.picture import write_figure, write_numbers
from megalopta.reproduction.sweep_figure import measure, over_templates, sweep_figure, thresholds

CHAPTER, TABLE = "chapter-4", "table-4.1"
"""Names of all figures together, and of the table"""
FIGURES = tuple(f"fig-4.{number}" for number in range(5, 14))

SIZE = 60
_SOURCES = {
    "synthetic": ("fig-4.5", "fig-4.8"),
    "natural": ("fig-4.11", "fig-4.12"),
    "photo": ("photographs",),
}
"""Sweeps of Table 4.1. The dissertation's panoramas are web pictures, whose gray values are not
linear in light."""
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
    "the forests (natural; photo: in gray values). Ranges: 95 % CI of the named experiment, "
    "which is not one of the least of many, or range over the forests. Σ|Δ|/Σ|R|: N_2b by the "
    "quotient of means, which does not divide by responses near zero. docs/results/dissertation.md "
    "says why values differ."
)
_SUMMARY = (
    "Chapter 4 of the dissertation, measured again: N_2b, the photons per frame at which the error "
    "by photon noise falls to 25 %."
)


@cache
def sweep(name: str, is_quick: bool = False) -> Sweep:
    """Return a sweep of Chapter 4, or "photographs".

    The quick form has the smallest frames, every third value and two forests.
    """
    full = load_sweep(Path(__file__).parent / "sweeps" / f"{name}.yaml")
    if not is_quick:
        return full
    changes: dict[str, Any] = {"templates": full.templates[:2]}
    if full.vary == "size":
        changes |= {"values": full.values[:2]}
    else:
        changes |= {"values": full.values[::3], "sizes": (SIZE,)}
    return Sweep(**{name: getattr(full, name) for name in Sweep.model_fields} | changes)


def reproduce(
    figures: Sequence[str], out: Path, is_quick: bool = False, workers: int | None = None
) -> list[Path]:
    """Write NAME.png, NAME.svg and NAME.csv of every named figure; return their paths.

    "chapter-4" names all. Results of the flow benchmark are kept in the folder `trials` of `out`,
    and not measured again. Quick forms, with fewer trials, go to its folder `quick`: complete ones
    are kept. Table 4.1 is CSV and a page, chapter-4.html. Raises UserError if a name is unknown or
    the folder is a file; nothing is written then.
    """
    names = (*FIGURES, TABLE)
    for name in figures:
        if name not in (CHAPTER, *names):
            raise UserError(
                f"reproduce: no figure {name!r}; give {CHAPTER} or some of {', '.join(names)}; "
                "examples/dissertation has the figures of Chapters 2 and 3"
            )
    chosen = [name for name in names if name in figures or CHAPTER in figures]
    drawn = ensure_directory(out / "quick" if is_quick else out)
    trials: list[Trial] = []
    for name in chosen:
        trials += table_trials(is_quick) if name == TABLE else sweep(name, is_quick).trials
    results = measure(trials, out, workers)
    paths = []
    with progress("Drawing figures", len(chosen), "figure") as advance:
        for name in chosen:
            if name == TABLE:
                rows = table_rows(results, is_quick)
                write_numbers(drawn / f"{TABLE}.csv", rows)
                paths += [drawn / f"{TABLE}.csv", _write_page(drawn, rows, chosen, is_quick)]
            else:
                figure = sweep_figure(name, sweep(name, is_quick), results)
                title = f"{figure.title} (quick form)" if is_quick else figure.title
                paths += write_figure(replace(figure, title=title), drawn)
            advance()
    return paths


def table_trials(is_quick: bool) -> list[Trial]:
    """Return the trials of Table 4.1."""
    names = [name for sources in _SOURCES.values() for name in sources]
    points = [point for name in names for point in sweep(name, is_quick).points]
    return [point.trial for point in points if point.size == SIZE]


def table_rows(results: Results, is_quick: bool = False) -> pd.DataFrame:
    """Return Table 4.1: the fewest photons of every method in any experiment, and where."""
    tables = []
    for images, names in _SOURCES.items():
        for name in names:
            chosen = sweep(name, is_quick)
            points = tuple(point for point in chosen.points if point.size == SIZE)
            part = over_templates(thresholds(points, results))
            parameter = {"template.cycles_per_frame": "f", "velocity_px": "v"}[chosen.vary]
            blur = ", blurred" if chosen.trial.blurred else ""
            where = [f"{parameter} = {value}{blur}" for value in part["value"]]
            tables.append(part.assign(images=images, found_at=where))
    table = pd.concat(tables, ignore_index=True).dropna(subset="photons_per_frame")
    table = table[(table["bits"] == 2) & table["method"].isin(PRINTED)]
    keys = ["images", "method", "metric"]
    least = table.loc[table.groupby(keys)["photons_per_frame"].idxmin()].set_index(keys)
    order = pd.MultiIndex.from_product((_SOURCES, PRINTED, METRICS), names=keys)
    rows = least.loc[order].reset_index()
    ends = rows[["low", "high"]].map(lambda flux: number(flux) if flux > 0 else UNDEFINED)
    thesis = [PRINTED[row.method][row.images != "synthetic"] for row in records(rows)]
    return rows.assign(
        thesis_photons_per_frame=thesis,
        interval=ends["low"] + " to " + ends["high"],
        ratio=rows["photons_per_frame"] / thesis,
    )[_COLUMNS]


_COLUMNS = [
    *("method", "images", "metric", "thesis_photons_per_frame", "photons_per_frame"),
    *("low", "high", "interval", "ratio", "found_at"),
]


def _write_page(out: Path, rows: pd.DataFrame, names: Sequence[str], is_quick: bool) -> Path:
    """Write chapter-4.html, with Table 4.1 and the pictures of the other names beside it."""
    literal, by_means = (rows[rows["metric"] == metric] for metric in METRICS)
    head = ("", "Thesis", "Ours", "Ratio", "95 % or forests", "Found at", "Σ|Δ|/Σ|R|")
    lines = tuple(
        (
            f"{row.method}, {row.images}",
            number(row.thesis_photons_per_frame),
            number(row.photons_per_frame),
            f"{row.ratio:.2f}",
            row.interval,
            row.found_at,
            number(ratio),
        )
        for row, ratio in zip(records(literal), by_means["photons_per_frame"], strict=True)
    )
    pictures = [
        sections.image(f"{name}.svg", sweep(name, is_quick).title)
        for name in names
        if name != TABLE
    ]
    page = [
        sections.Section("Table 4.1", NOTE, head, lines),
        sections.Section("Figures", body=sections.block("charts", *pictures)) if pictures else None,
    ]
    quick = " Quick form: fewer values, sizes and forests than in the dissertation."
    near = literal["ratio"].between(0.5, 2).sum()
    verdict = f" {near} of {len(literal)} agree with the printed ones within a factor of two."
    summary = _SUMMARY + verdict + (quick if is_quick else "")
    title = "Photons that motion detectors need"
    return sections.write_sections(out / "chapter-4.html", title, summary, page)
