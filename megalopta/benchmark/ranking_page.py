"""The page of a ranking: errors by method and light, plots, and where the ranking changes."""

from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from megalopta.benchmark import ranking as ranked, sequence_errors as errors, table
from megalopta.benchmark.ranking import BOUND, RANGES, STILL, Pooling, Ranking
from megalopta.report import sections, style
from megalopta.report.sections import Section
from megalopta.report.text import UNDEFINED, level_name, number, percent, short

_INK, _BLANK = "#1b1b1b", (0.0, 0.0, 0.0, 0.0)
"""Text on colors, which is the same on light and dark pages; color where nothing is measured"""
_SIZE_IN = (10.5, 4.8)
"""Width and height of large plots"""
_GROUPS = ("visible", "occluded", "smooth", "depth edge", "parallax low", "parallax high")

_ERRORS = (
    "Mean and median endpoint error of blocks (px per frame), and the share of blocks off by more "
    "than 3 px. Bold: surely lower than those of all other methods (95 % CI of every ratio). "
    "Pixels are perfect; the motion is that of the full image, without pooling. A block without a "
    "velocity counts as zero motion. "
)
_PLOTS = (
    "Bands are 95 % CI. The Poisson bound is the least error of an unbiased method that sees one "
    "block of known texture at a time, or the motion itself if that is smaller. Errors of methods "
    "that share evidence between blocks may be below it."
)
_POOLING = "Best method where photons are added over squares of pixels and over frames."
ATLAS = (
    "Best method and its mean error, without pooling, by photons per frame. Gray: no method beats "
    "the zero-motion baseline. Pale: the lead is not significant. Blank: not measured."
)
_CHANGES = (
    "Methods change places if the ratio of their mean errors is above 1 in one group of blocks and "
    "below 1 in the other. The table lists significant changes, by the rule of Benjamini and "
    "Hochberg at a false discovery rate of 5 %. Blocks under rotation alone, and those of low or "
    "high parallax, are visible in the next frame. Hidden blocks are not, and come from sequences "
    "with more motion than the camera's rotation."
)
_BLOCKS = (
    "Speed is low below {:g} px and high above {:g} px. Parallax is the motion that remains "
    "without the camera's rotation: low below {:g} px, high above {:g} px. Distance is low below "
    "{:g} m and high above {:g} m."
).format(*errors.SPEEDS_PX, *errors.PARALLAX_PX, *errors.DISTANCES_M)


def write_ranking(folder: Path, ranking: Ranking) -> Path:
    """Write ranking.html, ranking.csv and ranking.json to a folder; return the page."""
    ranked.write_tables(folder, ranking)
    is_pooled = len(ranking.facts.settings.poolings) > 1
    over_photons = [
        error_curves(ranking, ranked.MEAN, "mean endpoint error (px per frame)"),
        error_curves(ranking, ranked.FAR, "share of blocks beyond 3 px"),
        group_curves(ranking),
    ]
    page = [
        _answer(ranking),
        Section("Errors over photons", _PLOTS, body=_large(*over_photons)),
        Section("Best method by motion", ATLAS, body=_large(atlas(ranking))),
        Section("Pooling", _POOLING, body=_large(pooling_grid(ranking))) if is_pooled else None,
        _rank_changes(ranking),
        Section("Blocks", _BLOCKS, ("group", "blocks"), _block_rows(ranking)),
    ]
    title = "Flow methods on rendered sequences"
    header = sections.paragraph(caution(ranking), "warn")
    return sections.write_sections(
        folder / "ranking.html", title, best_methods(ranking), page, header=header
    )


def best_methods(ranking: Ranking) -> str:
    """Return a sentence with the method of the lowest error at each number of photons."""
    found = []
    for flux in sorted(ranking.facts.settings.fluxes):
        best = ranking.best_of(ranking.facts.settings.finest, flux, "all")
        if best is not None:
            name = "zero-motion baseline" if best["method"] == STILL else best["method"]
            sure = "" if best["surely_lowest"] else " (not significant)"
            found.append(f"{short(flux)}: {name}{sure}")
    return f"Lowest mean error by photons per frame: {', '.join(found)}."


def caution(ranking: Ranking) -> str:
    """Return a warning of lights at which errors are due to the rendering; empty for none."""
    facts = ranking.facts
    equal = facts.rendering_photons_per_px
    fluxes = sorted(facts.settings.fluxes)
    noisy = [flux for flux in fluxes if equal and flux / facts.frame_px >= equal]
    if equal is None or not noisy:
        return ""
    return (
        f"Caution: the rendering is as noisy as {number(equal)} photons per pixel. From "
        f"{short(noisy[0])} photons per frame on, errors are due to it at least as much as to "
        "photons; render with more light paths per pixel."
    )


def order_changes(ranking: Ranking) -> list[str]:
    """Return the number of significant changes of order, and their scope."""
    changed = [change.groups.what for change in ranked.changes(ranking)]
    blocks, count = ranking.facts.blocks, len(ranking.facts.sequences)
    has_blocks: dict[str, bool] = {}
    for one, other, what in ranked.opposed(blocks):
        has_blocks[what] = has_blocks.get(what, False) or bool(
            blocks.get(one) and blocks.get(other)
        )
    cases = ", ".join(
        f"{what} {changed.count(what) if there else '(no such blocks)'}"
        for what, there in has_blocks.items()
    )
    units = "sequences" if count >= ranked.FEWEST_SEQUENCES else "segments of these sequences only"
    return [
        f"Significant rank changes between two methods: {cases}.",
        f"Sequences: {count}; confidence intervals are over {units} (over sequences with "
        f"{ranked.FEWEST_SEQUENCES} or more).",
    ]


@style.in_style
def error_curves(ranking: Ranking, metric: str, label: str) -> Markup:
    """Draw a metric of all blocks over photons, a curve per method with its interval."""
    figure = Figure(figsize=_SIZE_IN, layout="constrained")
    _curves(figure.add_subplot(), ranking, metric, "all")
    figure.axes[0].set(xlabel="photons per frame", ylabel=label)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside right upper")
    return style.to_svg(figure, f"errors-{metric.replace('_', '-')}", f"{label}, over photons")


@style.in_style
def group_curves(ranking: Ranking) -> Markup:
    """Draw mean errors over photons, a panel per group of blocks; empty without such groups."""
    blocks = ranking.facts.blocks
    groups = [name for name in _GROUPS if 0 < blocks.get(name, 0) < blocks["all"]]
    if not groups:
        return Markup()
    rows = -(-len(groups) // 2)
    figure = Figure(figsize=(_SIZE_IN[0], 2.7 * rows + 0.4), layout="constrained")
    panels = figure.subplots(rows, 2, sharex=True, sharey=True, squeeze=False)
    for axes, group in zip(panels.flat, groups, strict=False):
        _curves(axes, ranking, ranked.MEAN, group)
        axes.set_title(f"{group}: {blocks[group]} blocks", loc="left")
    for axes in panels.flat[len(groups) :]:
        axes.set_axis_off()
    figure.supxlabel("photons per frame", fontsize=10)
    figure.supylabel("mean endpoint error (px per frame)", fontsize=10)
    figure.legend(*panels.flat[0].get_legend_handles_labels(), loc="outside right upper")
    return style.to_svg(figure, "errors-groups", "Mean errors over photons, by group of blocks")


def _curves(axes: Axes, ranking: Ranking, metric: str, group: str) -> None:
    rows = ranking.rows_of(metric, ranking.facts.settings.finest, group)
    for name, curve in rows.sort_values("photons").groupby("method", sort=False):
        photons, value = curve["photons"], curve["value"]
        if name in (STILL, BOUND):
            dash = ":" if name == STILL else "--"
            axes.plot(photons, value, color=style.BLACK, linestyle=dash, linewidth=1.2, label=name)
        else:
            look = style.method_style(str(name))
            band = {"color": look["color"], "alpha": 0.2, "linewidth": 0}
            axes.fill_between(photons, curve["low"], curve["high"], **band)
            axes.plot(photons, value, **look, markersize=4, label=name)
    axes.set_xscale("log")
    if metric == ranked.MEAN:
        axes.set_yscale("log")
    else:
        axes.set_ylim(0, None)
        axes.yaxis.set_major_formatter(PercentFormatter(1))
    axes.grid(True)


def atlas(ranking: Ranking) -> Markup:
    """Draw the best method by photons, for each speed and parallax of blocks."""
    rows = {}
    for speed, parallax in product(RANGES, RANGES):
        group = errors.cell_name(speed, parallax)
        if ranking.facts.blocks.get(group):
            faster, nearer = _range(errors.SPEEDS_PX, speed), _range(errors.PARALLAX_PX, parallax)
            label = f"speed {faster},\nparallax {nearer}"
            rows[label] = ranking.facts.settings.finest, group
    return _best(ranking, "atlas", "The best method by photons, speed and parallax", rows)


def pooling_grid(ranking: Ranking) -> Markup:
    """Draw the best method by photons, at every pooling."""
    rows = {str(each): (each, "all") for each in ranking.facts.settings.poolings}
    return _best(ranking, "pooling", "The best method by photons and pooling", rows)


@style.in_style
def _best(
    ranking: Ranking, name: str, title: str, rows: Mapping[str, tuple[Pooling, str]]
) -> Markup:
    """Draw the best method and its error, a row per pooling and group, a column per photons.

    Empty without rows.
    """
    if not rows:
        return Markup()
    fluxes = sorted(ranking.facts.settings.fluxes)
    size = (max(5.0, 2.6 + 1.0 * len(fluxes)), 0.9 + 0.6 * len(rows))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.add_subplot()
    colors = np.full((len(rows), len(fluxes), 4), _BLANK)
    for row, column in np.ndindex(len(rows), len(fluxes)):
        pooling, group = list(rows.values())[row]
        best = ranking.best_of(pooling, fluxes[column], group)
        if best is not None:  # paler if the lead is not significant
            method, share = best["method"], 0.75 if best["surely_lowest"] else 0.3
            color = style.GRAY if method == STILL else style.method_style(method)["color"]
            colors[row, column] = *(share * np.array(to_rgb(color)) + 1 - share), 1.0
            ink = _INK if colors[row, column, :3].mean() > 0.4 else "white"
            text = f"{method}\n{best['value']:.2g} px"
            axes.text(column, row, text, ha="center", va="center", fontsize=9.5, color=ink)
    axes.imshow(colors, aspect="auto")
    axes.set_yticks(range(len(rows)), list(rows))
    axes.set_xticks(range(len(fluxes)), [short(flux) for flux in fluxes])
    axes.set(xlabel="photons per frame")
    axes.grid(False)
    return style.to_svg(figure, name, title)


def _range(bounds: tuple[float, float], name: str) -> str:
    low, high = bounds
    texts = f"below {low:g} px", f"{low:g} to {high:g} px", f"above {high:g} px"
    return texts[RANGES.index(name)]


def _large(*plots: Markup) -> Markup:
    return sections.block("wide", *plots)


def _answer(ranking: Ranking) -> Section:
    """Return the table of mean, median and share beyond 3 px, by method and light."""
    facts, metrics = ranking.facts, (ranked.MEAN, ranked.MEDIAN, ranked.FAR)
    finest, fluxes = facts.settings.finest, sorted(facts.settings.fluxes)
    rows = pd.concat([ranking.rows_of(metric, finest) for metric in metrics])
    cell = {(row.metric, row.method, row.photons): row for row in table.records(rows)}
    bold, plain = Markup("<b>{}</b>"), Markup("{}")

    def text(metric: str, method: str, flux: float) -> Markup:
        if (row := cell.get((metric, method, flux))) is None:
            return Markup(UNDEFINED)
        value = percent(row.value) if metric == ranked.FAR else number(row.value)
        return (bold if row.surely_lowest else plain).format(value)

    lines = [
        (name, *(Markup(" · ").join(text(m, name, flux) for m in metrics) for flux in fluxes))
        for name in (*facts.settings.methods, STILL)
    ]
    level_at = {
        ranked.photons_at(facts.photons_per_lux_s, level, facts.settings.exposure_s): level
        for level in facts.settings.light_levels
    }
    heads = (
        f"{short(flux)} photons, {number(flux / facts.frame_px)} per px"
        + (f": {level_name(level_at[flux])}" if flux in level_at else "")
        for flux in fluxes
    )
    scope = (
        f"{order_changes(ranking)[1]} Frames: {facts.frames}. Photons per frame, lux and second: "
        f"{number(facts.photons_per_lux_s)}."
    )
    return Section("Errors", f"{_ERRORS}{scope}", ("method", *heads), tuple(lines))


def _rank_changes(ranking: Ranking) -> Section:
    def text(row: Any, is_inverted: bool) -> str:
        values = (row.value, row.low, row.high)
        if is_inverted:
            values = (1 / row.value, 1 / row.high, 1 / row.low)
        return f"{row.group}: {values[0]:.2f} ({values[1]:.2f} to {values[2]:.2f})"

    head = ("changes with", "photons", "errors of", "in one group", "in the other")
    rows = tuple(
        (
            change.groups.what,
            short(change.first.photons),
            f"{change.first.method} / {change.first.against}",
            text(change.first, False),
            text(change.second, True),
        )
        for change in ranked.changes(ranking)
    )
    return Section("Rank changes", f"{order_changes(ranking)[0]} {_CHANGES}", head, rows)


def _block_rows(ranking: Ranking) -> tuple[tuple[str, ...], ...]:
    blocks = ranking.facts.blocks.items()
    return tuple((name, str(count)) for name, count in blocks if "," not in name)
