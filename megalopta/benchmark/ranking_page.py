"""The page of a ranking: errors by method and light first, then plots over photons and groups."""

import math
from collections import defaultdict
from collections.abc import Callable
from functools import partial
from itertools import groupby, product
from pathlib import Path
from typing import Any

import pandas as pd
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter, PercentFormatter

from megalopta.benchmark import ranking as ranked, table
from megalopta.benchmark.ranking import BOUND, RANGES, STILL, Ranking, RankingFacts
from megalopta.core.files import write_text
from megalopta.core.quantities import UNDEFINED, number, percent, short
from megalopta.report import sections, style
from megalopta.report.sections import Section
from megalopta.report.text import level_name
from megalopta.stages.noise_warning import LIMIT

_LEGEND: dict[str, Any] = {"loc": "outside lower left", "ncols": 4}
"""Below, so that a telephone, where large plots scroll, shows it"""
_GROUPS = ("visible", "occluded", "smooth", "depth edge", "parallax low", "parallax high")

_METRICS = {
    table.MEAN: "mean endpoint error (px per frame)",
    table.MEDIAN: "median endpoint error (px per frame)",
    table.FAR: "share of blocks off by more than 3 px",
}
_ERRORS = (
    "In each cell the mean and the median endpoint error of blocks (px per frame) and the share of "
    "blocks off by more than 3 px. Bold: surely lower than those of all other methods (95 % CI of "
    "every ratio)."
)
_SCOPE = (
    "Pixels are perfect. A block without a velocity (none) counts as zero motion. Sequences: {}; "
    "frames: {}; confidence intervals are over {}. One lux for a second gives a frame {} photons."
)
_PLOTS = (
    "Lines are solid for the dissertation's methods, dashed for others. Bands are 95 % CI. The "
    "Poisson bound is the least error of an unbiased method that sees one block of known texture "
    "at a time, or the motion itself if that is smaller. Errors of methods that share evidence "
    "between blocks may be below it."
)
_BY_MOTION = (
    "The method with the least mean error (px per frame), bold where surely. Parallax is the "
    "motion that remains without the camera's rotation."
)


def write_ranking(folder: Path, ranking: Ranking) -> Path:
    """Write ranking.html, ranking.csv and ranking.json to a folder; return the page."""
    noise = ranking.rows["photons"].map(ranking.facts.rendering_noise)
    per_px = ranking.rows["photons"] / ranking.facts.frame_px
    long_table = ranking.rows.assign(photons_per_px=per_px, rendering_noise=noise)
    write_text(folder / "ranking.csv", long_table.to_csv(index=False, float_format="%.9g"))
    write_text(folder / "ranking.json", ranking.facts.model_dump_json(indent=1) + "\n")
    over_photons = [error_curves(ranking, metric) for metric in (table.MEDIAN, table.FAR)]
    more = [
        sections.block("pair", *over_photons),
        sections.block("pair", *group_curves(ranking)),
        sections.folded(
            "Best method by motion", sections.paragraph(_BY_MOTION, "note"), best_by_motion(ranking)
        ),
    ]
    page = [_errors(ranking), Section("More over photons", body=Markup("\n").join(more))]
    title = "Flow methods on rendered sequences"
    header = sections.paragraph(caution(ranking.facts), "warn")
    return sections.write_sections(
        folder / "ranking.html", title, verdict(ranking), page, header=header
    )


def verdict(ranking: Ranking) -> str:
    """Return who is first by mean error at which light, with its error, and where not by median."""
    leaders, exceptions, unsure = [], defaultdict[str, list[str]](list), []
    for flux in ranking.facts.settings.fluxes:
        by_mean, by_median = (
            ranking.best_of(flux, metric=metric) for metric in (table.MEAN, table.MEDIAN)
        )
        if by_mean is None or by_median is None:
            continue
        leaders.append(by_mean)
        if by_median["method"] != by_mean["method"]:
            exceptions[by_median["method"]].append(short(flux))
        if not by_mean["surely_lowest"]:
            unsure.append(short(flux))
    runs = []
    for method, rows in groupby(leaders, key=lambda row: str(row["method"])):
        *before, last = rows
        lights = dict.fromkeys(short(row["photons"]) for row in (*before[:1], last))
        interval = _interval(last["low"], last["high"])
        error = f"{number(last['value'])}{interval} px at {[*lights][-1]}"
        runs.append(f"{method} at {' to '.join(lights)} photons per frame, {error}")
    others = [f"{method} at {' and '.join(lights)}" for method, lights in exceptions.items()]
    median = f", but {', '.join(others)}" if others else ""
    text = f"Lowest mean error (95 % CI): {'; '.join(runs)}. By median error the same{median}."
    return text + (f" The lead may be chance at {', '.join(unsure)}." if unsure else "")


def _interval(low: float, high: float, write: Callable[[float], str] = number) -> str:
    return f" ({write(low)} to {write(high)})" if math.isfinite(low) else ""


def caution(facts: RankingFacts) -> str:
    """Return a warning of lights at which rendering noise rivals shot noise; empty for none."""
    if not facts.noisy_fluxes:
        return ""
    first, most = facts.noisy_fluxes[0], facts.noisy_fluxes[-1]
    noise = facts.rendering_noise(most)
    return (
        f"Caution: from {short(first)} photons per frame on, errors are partly of noise that no "
        f"camera has: at {short(most)}, rendering noise has {number(noise)} times the variance of "
        f"shot noise. Render with {short(math.ceil(noise / LIMIT))} times "
        "--render.samples-per-pixel (baked light: a lower --render.bake-error), or rank with "
        "fewer --fluxes."
    )


def _errors(ranking: Ranking) -> Section:
    """Return the errors by method and light beside their plot, and folded with intervals."""
    facts, settings = ranking.facts, ranking.facts.settings
    rows = pd.concat([ranking.rows_of(metric) for metric in _METRICS])
    cells = {(row.metric, row.method, row.photons): row for row in table.records(rows)}

    def cell(metric: str, method: str, flux: float, *, has_interval: bool = False) -> Markup:
        row, write = cells[metric, method, flux], percent if metric == table.FAR else number
        text = write(row.value) + (_interval(row.low, row.high, write) if has_interval else "")
        return Markup("<b>{}</b>" if row.surely_lowest else "{}").format(text)

    levels = {
        ranked.photons_at(facts.photons_per_lux_s, level, settings.exposure_s): level
        for level in settings.light_levels
    }
    heads = []
    for flux in settings.fluxes:
        of_light = [short(flux), level_name(levels[flux]) if flux in levels else ""]
        of_light.append(f"{number(flux / facts.frame_px)} per px")
        if flux in facts.noisy_fluxes:
            noise = number(facts.rendering_noise(flux))
            of_light.append(f"rendering noise {noise} × shot noise")
        heads.append(Markup("<br>").join(filter(None, of_light)))
    methods, head = (*settings.methods, STILL), ("photons per frame", *heads)

    def lines(text: Callable[[str, float], str]) -> list[list[str]]:
        return [[name, *(text(name, flux) for flux in settings.fluxes)] for name in methods]

    def errors(method: str, flux: float) -> Markup:
        share = missing.get((method, flux))
        none = [f"{percent(share)} none"] if share else []
        return Markup("<br>").join([*(cell(metric, method, flux) for metric in _METRICS), *none])

    missing = ranking.rows_of(table.NONE).set_index(["method", "photons"])["value"].to_dict()
    with_intervals = [
        sections.table(label, (label, *heads), lines(partial(cell, metric, has_interval=True)))
        for metric, label in _METRICS.items()
    ]
    count = len(facts.sequences)
    units = "sequences" if count >= ranked.FEWEST_SEQUENCES else "segments of these sequences only"
    scope = _SCOPE.format(count, facts.frames, units, number(facts.photons_per_lux_s))
    curves = error_curves(ranking, table.MEAN)
    body = [
        sections.block("pair", sections.table("Errors", head, lines(errors)), curves),
        sections.folded("With 95 % intervals", *with_intervals),
        sections.paragraph(f"{_PLOTS} {scope}", "note"),
    ]
    return Section("Errors", _ERRORS, body=Markup("\n").join(body))


@style.in_style
def error_curves(ranking: Ranking, metric: str) -> Markup:
    """Draw a metric of all blocks over photons, a curve per method with its interval."""
    figure, label = Figure(figsize=(6.3, 5.2), layout="constrained"), _METRICS[metric]
    axes = figure.add_subplot()
    _curves(axes, ranking, metric, "all")
    axes.set(xlabel="photons per frame", ylabel=label)
    figure.legend(*axes.get_legend_handles_labels(), **_LEGEND | {"ncols": 3})
    return style.to_svg(figure, f"errors-{metric.replace('_', '-')}", f"{label}, over photons")


@style.in_style
def group_curves(ranking: Ranking) -> list[Markup]:
    """Draw mean errors over photons, a figure per group of blocks, on one scale."""
    blocks, figures = ranking.facts.blocks, []
    groups = [name for name in _GROUPS if 0 < blocks.get(name, 0) < blocks["all"]]
    values = pd.concat([ranking.rows_of(table.MEAN, name)["value"] for name in ("all", *groups)])
    for group in groups:
        figure, axes = style.new_axes(*style.CHART_PT)
        _curves(axes, ranking, table.MEAN, group)
        axes.set(xlabel="photons per frame", ylabel=_METRICS[table.MEAN])
        axes.set_ylim(values[values > 0].min() / 1.2, 1.2 * values.max())
        axes.set_title(f"{group}: {blocks[group]} blocks", loc="left")
        name = f"errors-{group.replace(' ', '-')}"
        figures.append(style.to_svg(figure, name, f"Mean errors over photons: {group}"))
    return figures


def _curves(axes: Axes, ranking: Ranking, metric: str, group: str) -> None:
    rows = ranking.rows_of(metric, group)
    for name, curve in rows.sort_values("photons").groupby("method", sort=False):
        photons, value = curve["photons"], curve["value"]
        if name in (STILL, BOUND):
            color, dash = (style.GRAY, ":") if name == STILL else (style.BLACK, "--")
            axes.plot(photons, value, color=color, linestyle=dash, linewidth=1.2, label=name)
        else:
            look = style.method_style(str(name), ranking.facts.settings.methods)
            band = {"color": look["color"], "alpha": 0.2, "linewidth": 0}
            axes.fill_between(photons, curve["low"], curve["high"], **band)
            axes.plot(photons, value, **look, markersize=4, label=name)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(style.NUMBERS)
    if metric != table.FAR:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(style.NUMBERS)
        axes.yaxis.set_minor_formatter(NullFormatter())
    else:
        axes.set_ylim(0, 1.2 * rows["value"].max() or 0.01)  # not that of wide bands
        axes.yaxis.set_major_formatter(PercentFormatter(1))
    axes.grid(True)


def best_by_motion(ranking: Ranking) -> Markup:
    """Return the best method and its mean error by photons, a line per speed and parallax."""
    fluxes, lines = ranking.facts.settings.fluxes, []
    for speed, parallax in product(RANGES, RANGES):
        group = ranked.cell_name(speed, parallax)
        if not ranking.facts.blocks.get(group):
            continue
        motion = f"speed {_range(speed, ranked.SPEEDS_PX)}, "
        line = [motion + f"parallax {_range(parallax, ranked.PARALLAX_PX)}"]
        for flux in fluxes:
            best = ranking.best_of(flux, group)
            text = UNDEFINED if best is None else f"{best['method']} {number(best['value'])}"
            is_sure = best is not None and best["surely_lowest"]
            line.append(Markup("<b>{}</b>" if is_sure else "{}").format(text))
        lines.append(line)
    return sections.table(
        "Best method by motion", ("photons per frame", *map(short, fluxes)), lines
    )


def _range(name: str, limits: tuple[float, float]) -> str:
    low, high = limits
    texts = f"below {low:g} px", f"{low:g} to {high:g} px", f"above {high:g} px"
    return texts[RANGES.index(name)]
