"""Pictures of a ranking: curves, ratios, the grid of poolings, the atlas, flow fields."""

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from megalopta.benchmark.ranking import Ranking, RankingRow
from megalopta.benchmark.ranking_settings import Pooling
from megalopta.benchmark.sequence_errors import (
    BOUND,
    PARALLAX_PX,
    RANGES,
    SPEEDS_PX,
    STILL,
    cell_name,
    opposed,
)
from megalopta.core.arrays import Floats
from megalopta.flow.color_wheel import flow_to_rgb
from megalopta.plotting.style import BLACK, GRAY, PALETTE, method_style
from megalopta.plotting.svg import in_style, to_svg
from megalopta.plotting.text import number

_LUX = np.logspace(-4, 5, 91)
_EXPOSURES_S = np.logspace(-4, 0, 41)
_WHITE = 1.0
_KINDS = PALETTE[:3]


@in_style
def error_curves(ranking: Ranking, pooling: Pooling, group: str) -> Markup:
    """Mean endpoint error over photons, a curve per method with its interval."""
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
    """Mean errors over the first method's, by speed and photons, in the groups compared.

    Empty where no group has an answer of both.
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
    """The best method, and its error, at every pooling and number of photons."""
    settings, poolings = ranking.settings, ranking.settings.poolings
    fluxes = sorted(settings.fluxes)
    size = (max(4.5, 1.2 + 1.5 * len(poolings)), 1 + 0.55 * len(fluxes))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.add_subplot()
    colors = np.ones((len(fluxes), len(poolings), 3))
    for row, column in np.ndindex(len(fluxes), len(poolings)):
        case = poolings[column], fluxes[row], "all"
        best = ranking.best_of(*case)
        if best and (error := ranking.error_of(*case, best.method)):
            colors[row, column] = _shade(best)
            text = f"{best.method}\n{error.value:.2g} px"
            axes.text(column, row, text, ha="center", va="center", fontsize=9.5, color=BLACK)
    axes.imshow(colors, aspect="auto", origin="lower")
    axes.set_xticks(range(len(poolings)), [str(each).replace(", ", "\n") for each in poolings])
    axes.set_yticks(range(len(fluxes)), [number(flux) for flux in fluxes])
    axes.set(ylabel="photons per frame", title="best method by pooling")
    axes.grid(False)
    return to_svg(figure, "pooling", "The best method at every pooling and number of photons")


@in_style
def atlas(ranking: Ranking) -> Markup:
    """The best method over illuminance and exposure, a panel for each speed and parallax."""
    figure = Figure(figsize=(8.6, 8.8), layout="constrained")
    panels = figure.subplots(3, 3, sharex=True, sharey=True)
    shown: dict[str, None] = {}
    for row, speed in enumerate(reversed(RANGES)):
        for column, parallax in enumerate(RANGES):
            axes = panels[row, column]
            shown |= _panel(axes, ranking, cell_name(speed, parallax))
            if row == 0:
                axes.set_title(f"parallax {_range(PARALLAX_PX, column)}")
            if row == 2:
                axes.set_xlabel("exposure (s)")
            if column == 0:
                axes.set_ylabel(f"speed {_range(SPEEDS_PX, 2 - row)}\n\nilluminance (lux)")
    patches = [Patch(color=tuple(_tint(name, 0.75)), label=name) for name in shown]
    figure.legend(handles=patches, loc="outside lower center", ncols=6)
    return to_svg(figure, "atlas", "The best method over illuminance, exposure, speed and parallax")


@in_style
def flow_fields(
    fields: Mapping[str, Sequence[Floats]], fluxes: Sequence[float], speed: float
) -> Markup:
    """Velocities of one pair of frames: the truth, and each method at each number of photons."""
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
            if row == 0 and column == 0:
                axes.set_title("truth")
            elif row == 1:
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
    """Return the three groups that are compared at each speed where some method has a ratio."""
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
    colors = np.full((len(_LUX), len(_EXPOSURES_S), 3), _WHITE)
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
    """Color of a method, paler where the data cannot tell it from the next."""
    return _tint(best.method, 0.75 if best.value else 0.3)


def _tint(method: str, share: float) -> Floats:
    color = np.array(to_rgb(GRAY if method == STILL else method_style(method)["color"]))
    return np.asarray(share * color + (1 - share))


def _range(bounds: tuple[float, float], place: int) -> str:
    low, high = bounds
    return (f"below {low:g} px", f"{low:g} to {high:g} px", f"above {high:g} px")[place]
