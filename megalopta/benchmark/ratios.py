"""Picture of where methods change places: their errors over those of one, by group."""

import itertools

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from megalopta.benchmark.ranking_record import Ranking
from megalopta.benchmark.sequence_truth import RANGES, opposed
from megalopta.plotting.style import BLACK, PALETTE
from megalopta.plotting.svg import in_style, to_svg
from megalopta.plotting.text import number

_KINDS = PALETTE[:3]


@in_style
def error_ratios(ranking: Ranking) -> Markup:
    """Mean errors over the first method's, by speed and photons, in the groups compared.

    Empty where no group has an answer of both.
    """
    fluxes = sorted(ranking.settings.fluxes)
    first, *others = ranking.settings.methods
    compared = [each for each in opposed(ranking.blocks) if each.what in ("parallax", "occlusion")]
    half = len(compared) // 2
    shown = {}
    for speed, parallax, occlusion in zip(RANGES, compared[:half], compared[half:], strict=True):
        groups = (parallax.one, parallax.other, occlusion.other)
        pairs = itertools.product(groups, others)
        if any(ranking.order_of(fluxes[-1], each, first, name) for each, name in pairs):
            shown[speed] = groups
    if not shown:
        return Markup()
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
    groups = (compared[0].one, compared[0].other, compared[-1].other)
    handles = [
        Patch(color=color, label=group.split(",")[0])
        for color, group in zip(_KINDS, groups, strict=True)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return to_svg(figure, "ratios", f"Errors of methods over those of {first}, by parallax")


def _ratios(axes: Axes, ranking: Ranking, flux: float, group: str, place: int) -> None:
    """Draw the ratios of all methods but the first in one group, with their intervals."""
    first, *others = ranking.settings.methods
    for at, name in enumerate(others):
        order = ranking.order_of(flux, group, first, name)
        if order is None:
            continue
        values = np.array((order.ratio, order.low, order.high))
        middle, low, high = values if order.worse == name else 1 / values[[0, 2, 1]]
        x = at + 0.25 * (place - 1)
        axes.plot([x, x], [low, high], color=_KINDS[place], linewidth=1.5)
        axes.plot(x, middle, "o", color=_KINDS[place], markersize=3.5)
