"""The page of a ranking: its sections from top to bottom, and their charts."""

import itertools
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from megalopta.benchmark import block_truths as blocks, sequence_errors as metrics
from megalopta.benchmark.block_truths import RANGES, cell_name, opposed
from megalopta.benchmark.ranking import RankChange, Ranking, RankingRow, changes
from megalopta.benchmark.ranking_settings import Pooling, photons_at
from megalopta.benchmark.sequence_errors import BOUND, STILL, Example
from megalopta.benchmark.table import FEWEST_SEQUENCES, Case
from megalopta.config.model import LightLevel, level_text
from megalopta.core import files
from megalopta.core.arrays import Floats
from megalopta.flow.color_wheel import flow_to_rgb
from megalopta.report.sections import Section, write_sections
from megalopta.report.style import BLACK, GRAY, PALETTE, in_style, method_style, to_svg
from megalopta.report.text import UNDEFINED, number
from megalopta.scenes.lighting.levels import LEVELS, illuminance_of

_LUX = np.logspace(-4, 5, 91)
_EXPOSURES_S = np.logspace(-4, 0, 41)
_INK, _BLANK = "#1b1b1b", (0.0, 0.0, 0.0, 0.0)
"""Text on colors, which is the same on light and dark pages; color where nothing is measured"""
_KINDS = PALETTE[:3]


@in_style
def error_curves(ranking: Ranking, pooling: Pooling, group: str) -> Markup:
    """Draw mean endpoint error over photons, a curve per method with its interval."""
    figure = Figure(figsize=(5.3, 4.2), layout="constrained")
    axes = figure.add_subplot()
    for name in (*ranking.settings.methods, STILL, BOUND):
        _curve(axes, ranking, pooling, group, name)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="photons per frame",
        ylabel="mean endpoint error (px per frame)",
        title=f"{group}; {pooling}",
    )
    axes.grid(True)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    name = f"errors-{group}-{pooling.pixels}-{pooling.frames}".replace(" ", "-").replace(",", "")
    return to_svg(figure, name, f"Endpoint error of every method over photons: {group}, {pooling}")


@in_style
def error_ratios(ranking: Ranking) -> Markup:
    """Draw mean errors over the first method's, by speed and photons, in the compared groups.

    Empty if no group has values of both.
    """
    fluxes, shown = sorted(ranking.settings.fluxes), _compared(ranking)
    if not shown:
        return Markup()
    first, *others = ranking.settings.methods
    figure = Figure(figsize=(1.2 + 2.1 * len(fluxes), 1.2 + 1.9 * len(shown)), layout="constrained")
    panels = figure.subplots(len(shown), len(fluxes), sharex=True, sharey=True, squeeze=False)
    for row, (speed, groups) in enumerate(shown.items()):
        for flux, axes in zip(fluxes, panels[row], strict=True):
            for place, group in enumerate(groups):
                _ratios(axes, ranking, flux, group, place)
            axes.axhline(1, color=BLACK, linewidth=0.8)
            axes.set(yscale="log", xticks=range(len(others)), xticklabels=others)
            axes.tick_params(axis="x", rotation=90)
            if row == 0:
                axes.set_title(f"{number(flux)} photons", fontsize=10)
        panels[row, 0].set_ylabel(f"speed {speed}\nerror over {first}'s", fontsize=9)
    names = (group.split(",")[0] for group in next(iter(shown.values())))
    handles = [Patch(color=color, label=name) for color, name in zip(_KINDS, names, strict=True)]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return to_svg(figure, "ratios", f"Errors of methods over those of {first}, by parallax")


@in_style
def pooling_grid(ranking: Ranking) -> Markup:
    """Draw the best method and its error at every pooling and number of photons."""
    settings, poolings = ranking.settings, ranking.settings.poolings
    fluxes = sorted(settings.fluxes)
    size = (max(4.5, 1.2 + 1.5 * len(poolings)), 1 + 0.55 * len(fluxes))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.add_subplot()
    colors = np.full((len(fluxes), len(poolings), 4), _BLANK)
    for row, column in np.ndindex(len(fluxes), len(poolings)):
        case = poolings[column], fluxes[row], "all"
        best = ranking.best_of(*case)
        if best and (error := ranking.error_of(*case, best.method)):
            colors[row, column] = _shade(best)
            ink = _INK if colors[row, column, :3].mean() > 0.4 else "white"
            text = f"{best.method}\n{error.value:.2g} px"
            axes.text(column, row, text, ha="center", va="center", fontsize=9.5, color=ink)
    axes.imshow(colors, aspect="auto", origin="lower")
    axes.set_xticks(range(len(poolings)), [str(each).replace(", ", "\n") for each in poolings])
    axes.set_yticks(range(len(fluxes)), [number(flux) for flux in fluxes])
    axes.set(ylabel="photons per frame", title="best method by pooling")
    axes.grid(False)
    return to_svg(figure, "pooling", "The best method at every pooling and number of photons")


@in_style
def atlas(ranking: Ranking) -> Markup:
    """Draw the best method over illuminance and exposure, a panel per speed and parallax."""
    figure = Figure(figsize=(8.6, 8.8), layout="constrained")
    panels = figure.subplots(3, 3, sharex=True, sharey=True)
    shown: dict[str, None] = {}
    for row, speed in enumerate(reversed(RANGES)):
        for column, parallax in enumerate(RANGES):
            axes = panels[row, column]
            shown |= _panel(axes, ranking, cell_name(speed, parallax))
            if row == 0:
                axes.set_title(f"parallax {_range(blocks.PARALLAX_PX, column)}")
            if row == 2:
                axes.set_xlabel("exposure (s)")
            if column == 0:
                axes.set_ylabel(f"speed {_range(blocks.SPEEDS_PX, 2 - row)}\n\nilluminance (lux)")
    patches = [Patch(color=tuple(_tint(name, 0.75)), label=name) for name in shown]
    figure.legend(handles=patches, loc="outside lower center", ncols=6)
    return to_svg(figure, "atlas", "The best method over illuminance, exposure, speed and parallax")


@in_style
def flow_fields(
    fields: Mapping[str, Sequence[Floats]], fluxes: Sequence[float], speed: float
) -> Markup:
    """Draw velocities of one pair of frames: truth, and each method at each number of photons."""
    rows, columns = len(fields), max(len(each) for each in fields.values())
    figure = Figure(figsize=(0.9 + 1.7 * columns, 1.6 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False)
    for row, (name, flows) in enumerate(fields.items()):
        for column in range(columns):
            axes = panels[row, column]
            axes.set(xticks=[], yticks=[])
            axes.grid(False)
            if column < len(flows):
                axes.imshow(flow_to_rgb(flows[column], speed), interpolation="nearest")
            else:
                axes.set_axis_off()
            if row == 1:
                axes.set_title(f"{number(fluxes[column])} photons", fontsize=10)
        panels[row, 0].set_ylabel(name)
    return to_svg(figure, "fields", "Flow of one pair of frames: truth, and methods over photons")


def _curve(axes: Axes, ranking: Ranking, pooling: Pooling, group: str, name: str) -> None:
    fluxes = sorted(ranking.settings.fluxes)
    found = [each for flux in fluxes if (each := ranking.error_of(pooling, flux, group, name))]
    at = [each.photons_per_frame for each in found]
    mean, low, high = np.array([(each.value, each.low, each.high) for each in found], float).T
    if name in (STILL, BOUND):
        dash = ":" if name == STILL else "--"
        axes.plot(at, mean, color=BLACK, linestyle=dash, linewidth=1.2, label=name)
    else:
        style = method_style(name)
        axes.fill_between(at, low, high, color=style["color"], alpha=0.2, linewidth=0)
        axes.plot(at, mean, **style, markersize=4, label=name)


def _compared(ranking: Ranking) -> dict[str, tuple[str, str, str]]:
    """Return the three groups compared at each speed where some method has a ratio."""
    most, (first, *others) = max(ranking.settings.fluxes), ranking.settings.methods
    compared = [each for each in opposed(ranking.blocks) if each.what in ("parallax", "occlusion")]
    half, shown = len(compared) // 2, {}
    for speed, parallax, occlusion in zip(RANGES, compared[:half], compared[half:], strict=True):
        groups = (parallax.one, parallax.other, occlusion.other)
        pairs = itertools.product(groups, others)
        if any(ranking.order_of(most, each, first, name) for each, name in pairs):
            shown[speed] = groups
    return shown


def _ratios(axes: Axes, ranking: Ranking, flux: float, group: str, place: int) -> None:
    """Draw the ratios of all methods but the first in one group, with their intervals."""
    first, *others = ranking.settings.methods
    for at, name in enumerate(others):
        order = ranking.order_of(flux, group, first, name)
        if order is None:
            continue
        values = np.array((order.value, order.low, order.high), float)
        middle, low, high = values if order.method == name else 1 / values[[0, 2, 1]]
        x = at + 0.25 * (place - 1)
        axes.plot([x, x], [low, high], color=_KINDS[place], linewidth=1.5)
        axes.plot(x, middle, "o", color=_KINDS[place], markersize=3.5)


def _panel(axes: Axes, ranking: Ranking, group: str) -> dict[str, None]:
    fluxes = np.array(sorted(ranking.settings.fluxes))
    shown: dict[str, None] = {}
    colors = np.full((len(_LUX), len(_EXPOSURES_S), 4), _BLANK)
    flux = ranking.photons_per_lux_s * np.outer(_LUX, _EXPOSURES_S)
    nearest = np.argmin(np.abs(np.log(flux[..., np.newaxis] / fluxes)), axis=-1)
    half = np.sqrt(fluxes[1] / fluxes[0]) if len(fluxes) > 1 else 3.0
    measured = (flux > fluxes[0] / half) & (flux < fluxes[-1] * half)
    for place, each in enumerate(fluxes):
        best = ranking.best_of(ranking.settings.finest, float(each), group)
        if best is not None:
            shown[best.method] = None
            colors[measured & (nearest == place)] = _shade(best)
    edges = [_EXPOSURES_S[0], _EXPOSURES_S[-1], _LUX[0], _LUX[-1]]
    axes.pcolormesh(_EXPOSURES_S, _LUX, colors, shading="nearest", rasterized=True)
    axes.set(xscale="log", yscale="log", xlim=edges[:2], ylim=edges[2:])
    axes.grid(False)
    if not shown:
        axes.text(0.5, 0.5, "no blocks", transform=axes.transAxes, ha="center", color=GRAY)
    return shown


def _shade(best: RankingRow) -> Floats:
    """Color of a method, paler if its lead is not significant."""
    return _tint(best.method, 0.75 if best.value else 0.3)


def _tint(method: str, share: float) -> Floats:
    color = np.array(to_rgb(GRAY if method == STILL else method_style(method)["color"]))
    return np.append(share * color + (1 - share), 1.0)


def _range(bounds: tuple[float, float], place: int) -> str:
    low, high = bounds
    return (f"below {low:g} px", f"{low:g} to {high:g} px", f"above {high:g} px")[place]


EXPOSURES_S = (0.001, 0.01, 0.1)
_NEAR = 3.0
"""Factor in photons within which a measurement represents a level."""
_GROUPS = ("all", "visible", "occluded", "smooth", "depth edge", "parallax low", "parallax high")

_MEASURED = (
    "All pixels are perfect. Errors are endpoint errors of blocks against the true motion, in px "
    "of the full image per frame. A block without a velocity counts as zero motion. Means are over "
    "all blocks, and bands are their 95 % CI. Speed is low below {:g} px and high above {:g} px. "
    "Parallax is the motion that remains without the camera's rotation: low below {:g} px, high "
    "above {:g} px. Distance is low below {:g} m and high above {:g} m."
).format(*blocks.SPEEDS_PX, *blocks.PARALLAX_PX, *blocks.DISTANCES_M)
_CHANGES = (
    "The picture shows ratios of two methods' mean errors with 95 % CI. Methods change places if "
    "the ratio is above 1 in one group of blocks and below 1 in the other. The table lists "
    "significant changes, by the rule of Benjamini and Hochberg at a false discovery rate of 5 %. "
    "Blocks under rotation alone, and those of low or high parallax, are visible in the next "
    "frame. Hidden blocks are not, and come from sequences with more motion than the camera's "
    "rotation."
)
_ERRORS = (
    "The Poisson bound is the least error of an unbiased method that sees one block of known "
    "texture at a time, or the motion itself if that is smaller. Errors of methods that share "
    "evidence between blocks may be below it."
)
_POOLING = (
    "Photons are added over squares of pixels and over frames. Pale: the lead of the best method "
    "is not significant."
)
ATLAS = (
    "Best method without pooling. Gray: no method beats the zero-motion baseline. Pale: the lead "
    "is not significant. Blank: not measured."
)
_LEVELS = (
    "Best method without pooling on perfect pixels, and photons per frame, by exposure time. Light "
    "keeps the rendered color. A level is represented by the nearest measurement within a factor "
    f"of {_NEAR:g} in photons."
)
_FIELDS = (
    "One pair of frames in the middle of the first sequence: hue is direction, saturation speed; "
    "mid gray: no estimate."
)
_CAMERA = (
    "Angles between estimated and true rotation, and between headings, estimated from the "
    "velocities of all blocks of a pair of frames, or by maximum likelihood from the counts of two "
    "frames, or of eight around the pair. Medians over pairs and sequences."
)
_YAW_RATE = (
    "RMS error (deg/s) of the camera's yaw rate from a weighted sum of all responses, in "
    "parentheses without noise, and RMS of the true rate. Weights are learned from noise-free "
    "responses to the first half of a sequence and tested on the second. Methods that are blind to "
    "direction (NDM, NDS, IM) are not ranked."
)


def write_ranking(folder: Path, ranking: Ranking, example: Example) -> Path:
    """Write ranking.html, ranking.csv and ranking.json to a folder; return the page."""
    rows = (tuple(row.model_dump().values()) for row in ranking.rows)
    files.write_csv(folder / "ranking.csv", tuple(RankingRow.model_fields), rows)
    files.write_text(folder / "ranking.json", ranking.model_dump_json(indent=1) + "\n")
    made = (section(ranking, example) for section in SECTIONS)
    sections = (each for each in made if each.rows or each.charts)
    title = "Flow methods on rendered sequences"
    return write_sections(folder / "ranking.html", title, best_methods(ranking), sections)


def best_methods(ranking: Ranking) -> str:
    """Return a sentence with the method of the lowest error at each number of photons."""
    found = []
    for flux in sorted(ranking.settings.fluxes):
        if best := ranking.best_of(ranking.settings.finest, flux, "all"):
            found.append(f"{number(flux)}: {_named(best)}")
    return f"Lowest mean error by photons per frame: {', '.join(found)}."


def order_changes(ranking: Ranking) -> list[str]:
    """Return the number of significant changes of order, and their scope."""
    counts = Counter(each.groups.what for each in changes(ranking))
    has_blocks: dict[str, bool] = {}
    for each in opposed(ranking.blocks):
        there = all(ranking.blocks.get(group) for group in each[:2])
        has_blocks[each.what] = has_blocks.get(each.what, False) or there
    cases = ", ".join(
        f"{what} {counts[what] if there else '(no such blocks)'}"
        for what, there in has_blocks.items()
    )
    count = len(ranking.sequences)
    units = "sequences" if count >= FEWEST_SEQUENCES else "segments of these sequences only"
    return [
        f"Significant rank changes between two methods: {cases}.",
        f"Sequences: {count}; confidence intervals are over {units} (over sequences with "
        f"{FEWEST_SEQUENCES} or more).",
    ]


def _measured(ranking: Ranking, _: Example) -> Section:
    rows = (
        ("sequences", str(len(ranking.sequences))),
        ("frames", str(ranking.frames)),
        *((f"blocks: {name}", str(n)) for name, n in ranking.blocks.items() if "," not in name),
    )
    return Section("Measurements", _MEASURED, ("", "number"), rows)


def _changes(ranking: Ranking, _: Example) -> Section:
    head = ("changes with", "photons", "errors of", "in one group", "in the other")
    rows = tuple(map(_change, changes(ranking)))
    text = f"{' '.join(order_changes(ranking))} {_CHANGES}"
    return Section("Rank changes", text, head, rows, (error_ratios(ranking),))


def _change(change: RankChange) -> tuple[str, ...]:
    first, second = change.first, change.second
    low, high = first.low or 0.0, first.high or 0.0
    back = [1 / each if each else 0.0 for each in (second.value, second.high, second.low)]
    return (
        change.groups.what,
        number(first.photons_per_frame),
        f"{first.method} / {first.against}",
        f"{change.groups.one}: {first.value:.2f} ({low:.2f} to {high:.2f})",
        f"{change.groups.other}: {back[0]:.2f} ({back[1]:.2f} to {back[2]:.2f})",
    )


def _errors(ranking: Ranking, _: Example) -> Section:
    finest = ranking.settings.finest
    groups = (name for name in _GROUPS if ranking.blocks.get(name))
    charts = tuple(error_curves(ranking, finest, group) for group in groups)
    return Section("Errors over photons", _ERRORS, charts=charts)


def _levels(ranking: Ranking, _: Example) -> Section:
    """Return the best method at every named level, and at the requested levels."""
    settings = ranking.settings
    levels: dict[str, LightLevel] = {
        level_text(each): each for each in (*LEVELS, *settings.light_levels)
    }
    exposures = sorted({*EXPOSURES_S, settings.exposure_s})
    rows = tuple(
        (name, f"{illuminance_of(level):.3g}", *(_lit(ranking, level, t) for t in exposures))
        for name, level in sorted(levels.items(), key=lambda each: -illuminance_of(each[1]))
    )
    head = ("level", "lux", *(f"{exposure:g} s" for exposure in exposures))
    return Section("Light levels", _LEVELS, head, rows)


def _lit(ranking: Ranking, level: LightLevel, exposure_s: float) -> str:
    photons = photons_at(ranking.photons_per_lux_s, level, exposure_s)
    nearest = min(ranking.settings.fluxes, key=lambda each: abs(np.log(each / photons)))
    best = ranking.best_of(ranking.settings.finest, nearest, "all")
    if best is None or abs(np.log(nearest / photons)) > np.log(_NEAR):
        return f"{UNDEFINED} ({number(photons)})"
    return f"{_named(best)} ({number(photons)})"


def _fields(ranking: Ranking, example: Example) -> Section:
    fluxes = sorted(ranking.settings.fluxes)
    found = {name: [each[flux] for flux in fluxes] for name, each in example.found.items()}
    fastest = float(np.nanquantile(np.linalg.norm(example.truth, axis=-1), 0.98))
    chart = flow_fields({"truth": [example.truth], **found}, fluxes, fastest or 1.0)
    return Section("Flow fields", _FIELDS, charts=(chart,))


def _camera(ranking: Ranking, _: Example) -> Section:
    def cell(rotation: float, heading: float | None) -> str:
        return f"{rotation:.2g}°, {UNDEFINED if heading is None else f'{heading:.2g}°'}"

    shown = metrics.ROTATION, metrics.HEADING
    return _by_photons(ranking, "Camera motion", _CAMERA, cell, shown)


def _yaw_rate(ranking: Ranking, _: Example) -> Section:
    def cell(counts: float, ideal: float | None, true: float | None) -> str:
        return f"{counts:.2g} ({ideal:.2g}) of {true:.3g}"

    title = "Yaw rate, with methods without velocities"
    shown = metrics.YAW, metrics.YAW_OF_LIGHT, metrics.TRUE_YAW
    return _by_photons(ranking, title, _YAW_RATE, cell, shown)


SECTIONS: tuple[Callable[[Ranking, Example], Section], ...] = (
    _measured,
    _changes,
    _errors,
    lambda ranking, _: Section("Pooling", _POOLING, charts=(pooling_grid(ranking),)),
    lambda ranking, _: Section("Atlas", ATLAS, charts=(atlas(ranking),)),
    _levels,
    _fields,
    _camera,
    _yaw_rate,
)
"""The page, from top to bottom"""


def _by_photons(
    ranking: Ranking, title: str, text: str, cell: Callable[..., str], shown: tuple[str, ...]
) -> Section:
    """Return a table of methods by photons; a cell shows the values of metrics."""
    fluxes = sorted(ranking.settings.fluxes)
    methods = dict.fromkeys(row.method for row in ranking.rows if row.metric == shown[0])

    def text_of(name: str, flux: float) -> str:
        cases = (Case(metric, name, flux, "all", *ranking.settings.finest) for metric in shown)
        found = list(map(ranking.row_of, cases))
        return cell(*(row and row.value for row in found)) if found[0] else UNDEFINED

    rows = tuple((name, *(text_of(name, flux) for flux in fluxes)) for name in methods)
    head = ("method", *(f"{number(flux)} photons" for flux in fluxes))
    return Section(title, text, head, rows)


def _named(best: RankingRow) -> str:
    method = "zero-motion baseline" if best.method == STILL else best.method
    return method if best.value else f"{method} (not significant)"
