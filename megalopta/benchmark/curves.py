"""Charts of errors over photons, a curve per method."""

import math
import re

import pandas as pd
from markupsafe import Markup
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, PercentFormatter

from megalopta.benchmark import table
from megalopta.report import style

STILL = "zero"
"""Baseline that a method must beat: no motion anywhere"""
BOUND = "Poisson bound"
METRICS = {
    table.MEAN: "mean endpoint error (px per frame)",
    table.MEDIAN: "median endpoint error (px per frame)",
    table.FAR: "share off by more than 3 px",
}
LEGEND = "Dashed: on square roots of counts (√). Thick: methods of your own."
_BASELINES = {STILL: (style.GRAY, ":"), BOUND: (style.BLACK, "-.")}
"""Color and dash"""


@style.in_style
def error_chart(
    rows: pd.DataFrame, metric: str, unit: tuple[str, str, int], title: str, like: pd.DataFrame
) -> Markup:
    """Draw rows of `table.means` of a metric over photons in a unit, with bars side by side.

    `unit`: as `RankingFacts.unit`; `like`: rows whose values set the scale, which cuts bars off.
    """
    figure = Figure(figsize=(6.3, 5.2), layout="constrained")
    axes = figure.add_subplot(title=title, xlabel=unit[0], ylabel=METRICS[metric])
    rows = rows.assign(photons=rows["photons"] / unit[2])
    curves = rows.sort_values("photons").groupby("method", sort=False)
    methods = [str(method) for method in curves.groups if method not in _BASELINES]
    lights = sorted(rows["photons"].unique())
    decades = math.log10(lights[-1] / lights[0]) / max(len(lights) - 1, 1) or 0.2  # between two
    step = 10 ** (0.3 * decades / max(len(methods), 6))
    for method, curve in curves:
        photons, value = curve["photons"], curve["value"]
        if method in _BASELINES:
            color, dash = _BASELINES[str(method)]
            axes.plot(photons, value, dash, color=color, linewidth=1.2, label=method)
        else:
            look = style.method_style(str(method), methods)
            beside = step ** (methods.index(str(method)) - (len(methods) - 1) / 2)
            bars = [(value - curve["low"]).fillna(0), (curve["high"] - value).fillna(0)]
            axes.errorbar(photons * beside, value, bars, **look, elinewidth=1, label=method)
    unscaled = [BOUND, *([STILL] if metric == table.FAR else [])]
    values = like.loc[~like["method"].isin(unscaled), "value"]
    style.logarithmic(axes, "x", style.NUMBERS)
    axes.set_xticks(lights)
    if metric == table.FAR:
        axes.set_ylim(0, 1.2 * max([*values, 0.01]))
        axes.yaxis.set_major_formatter(PercentFormatter(1))
    else:
        style.logarithmic(axes, "y", style.NUMBERS)
        axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axes.set_ylim(values.clip(1e-3).min() / 1.5, 1.5 * values.clip(1e-3).max())
    axes.grid(True)
    figure.legend(loc="outside lower left", ncols=3)
    name = re.sub(r"\W+", "-", f"{metric} {title}")
    return style.to_svg(figure, name, f"{title}: {METRICS[metric]}, over {unit[0]}")
