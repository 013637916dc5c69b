"""A sweep as a figure: the flux that each detector needs over the varied parameter."""

import math
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import EngFormatter, LogLocator, NullFormatter

from megalopta.benchmark import trial as sweeps
from megalopta.benchmark.panoramas import ROWS
from megalopta.core.folders import ensure_directory
from megalopta.report import style
from megalopta.reproduction.picture import Figure, write_figure

_LABELS = {
    "template.cycles_per_frame": "Cycles per frame",
    "template.contrast": "Michelson contrast",
    "template.variant": "Variant of the grating",
    "search.dark_counts": "Dark counts per pixel",
    "search.summed_frames": "Frames summed",
    "velocity_px": "Velocity (px per frame)",
    "blurred": "Blurred by motion",
    "size": "Pooling N (px)",
}


def reproduce_sweep(
    name: str, sweep: sweeps.Sweep, out: Path, workers: int | None = None
) -> list[Path]:
    """Measure a sweep and write its figure under this name, as PNG, SVG and CSV.

    Results are kept in the folder `trials` of `out`, and not measured again. Raises UserError if
    the folder is a file; nothing is written then.
    """
    ensure_directory(out)
    return write_figure(sweep_figure(name, sweep, measure(sweep.trials, out, workers)), out)


def measure(
    trials: Sequence[sweeps.Trial], out: Path, workers: int | None = None
) -> sweeps.Results:
    """Return the error curves of trials, kept in the folder `trials` of `out`.

    They are measured on so many threads, by default one per core.
    """
    templates = sweeps.template_pixels(trial.template for trial in trials)
    return sweeps.run(trials, templates, out / "trials", workers)


def thresholds(points: Iterable[sweeps.SweepPoint], results: sweeps.Results) -> pd.DataFrame:
    """Return the long table of a sweep: a row per trial, method, metric and number of bits.

    NaN is no threshold, or an end of an interval beyond the curve.
    """
    rows = (
        {
            "size_px": point.size,
            "value": point.value,
            "template": point.template,
            "method": curve.method,
            "metric": curve.metric,
            "bits": bits,
            "kind": threshold.kind,
            "photons_per_frame": threshold.flux,
            "low": threshold.low,
            "high": threshold.high,
        }
        for point in points
        for curve in results[point.trial]
        for bits, threshold in curve.thresholds.items()
    )
    numbers = ("photons_per_frame", "low", "high")
    return pd.DataFrame(rows).astype(dict.fromkeys(numbers, float) | {"value": object})


def over_templates(table: pd.DataFrame) -> pd.DataFrame:
    """Return the mean over templates, NaN if not all have a threshold.

    For one template the ends are its confidence interval, for several the least and the most.
    """
    photons = "photons_per_frame"
    groups = table.groupby(["size_px", "value", "method", "metric", "bits"], sort=False)
    means = groups.agg(
        **{photons: (photons, lambda values: values.mean(skipna=False))},
        least=(photons, "min"),
        most=(photons, "max"),
        low=("low", "first"),
        high=("high", "first"),
        templates=("template", "nunique"),
    ).reset_index()
    several, known = means["templates"] > 1, means[photons].notna()
    means["low"] = means["least"].where(several, means["low"]).where(known)
    means["high"] = means["most"].where(several, means["high"]).where(known)
    return means.drop(columns=["least", "most", "templates"])


def sweep_figure(name: str, sweep: sweeps.Sweep, results: sweeps.Results) -> Figure:
    """Draw N_2b, in the first metric, over the varied parameter; a panel per size."""
    table = thresholds(sweep.points, results)
    rows = math.ceil(len(_sizes(sweep)) / 2)
    return Figure(
        name=name,
        title=sweep.title,
        caption=_caption(sweep, table),
        draw=partial(_draw, sweep=sweep, table=over_templates(_first(sweep, table))),
        numbers=table,
        height_in=4.0 if rows == 1 else 2.8 * rows,
    )


def _first(sweep: sweeps.Sweep, table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows in the first metric and number of bits, which are drawn."""
    search = sweep.trial.search
    return table[(table["metric"] == search.metrics[0]) & (table["bits"] == search.bits[0])]


def _sizes(sweep: sweeps.Sweep) -> tuple[int, ...]:
    return (sweep.trial.size,) if sweep.vary == "size" else sweep.sizes or (sweep.trial.size,)


def _caption(sweep: sweeps.Sweep, table: pd.DataFrame) -> str:
    search, templates = sweep.trial.search, sweep.templates
    metric = {"literal": "Eq. 4.5", "ratio": "the quotient of means"}[search.metrics[0]]
    bars = "95 % intervals"
    if len(templates) > 1:
        bars = f"the range over {len(templates)} templates"
    drawn = _first(sweep, table)
    without = drawn[drawn["photons_per_frame"].isna()]
    missing = without.groupby("method", sort=False).size().to_dict()
    return (
        f"N_{search.bits[0]}b is the photons per frame at which the error of {metric} falls to "
        f"{100 * 2.0 ** -search.bits[0]:g} %; bars are {bars}. Fixed, for frames of "
        f"{ROWS} × {ROWS} px: {', '.join(_fixed(sweep))}. Points without N_{search.bits[0]}b: "
        f"{', '.join(f'{name} {count}' for name, count in missing.items()) or 'none'}."
    )


def _fixed(sweep: sweeps.Sweep) -> Iterator[str]:
    """Yield the fixed settings of all trials, by their names in a sweep's file."""
    trial, pictures = sweep.trial, sweep.templates or (sweep.trial.template,)
    fixed: dict[str, object] = {"velocity_px": trial.velocity_px}
    if isinstance(template := pictures[0], sweeps.GratingTemplate):
        for name in ("cycles_per_frame", "contrast", "variant"):
            fixed[f"template.{name}"] = getattr(template, name)
    else:
        names = dict.fromkeys(point.template.split(",")[0] for point in sweep.points)
        fixed |= {"template.coding": template.coding, "template.name": " and ".join(names)}
    fixed["search.dark_counts"] = trial.search.dark_counts
    fixed |= {"search.summed_frames": trial.search.summed_frames, "blurred": trial.blurred}
    if len(sizes := _sizes(sweep)) == 1:
        fixed["size"] = sizes[0]
    yield from (f"{path} {value}" for path, value in fixed.items() if path != sweep.vary)


def _draw(canvas: Canvas, sweep: sweeps.Sweep, table: pd.DataFrame) -> None:
    sizes = _sizes(sweep)
    shape = math.ceil(len(sizes) / 2), min(len(sizes), 2)
    panels = canvas.subplots(*shape, sharex=True, sharey=True, squeeze=False).ravel()
    for axes, size in zip(panels, sizes, strict=False):
        is_shown = table["size_px"].eq(size) | (sweep.vary == "size")
        _draw_panel(axes, sweep, table[is_shown])
        if len(sizes) > 1:
            axes.set_title(f"N = {size}", loc="left")
    for axes in panels[len(sizes) :]:
        axes.set_axis_off()
    canvas.legend(*panels[0].get_legend_handles_labels(), loc="outside right center")


def _draw_panel(axes: Axes, sweep: sweeps.Sweep, table: pd.DataFrame) -> None:
    search = sweep.trial.search
    values: list[sweeps.Value] = table["value"].unique().tolist()
    is_text = any(isinstance(value, (str, bool)) for value in values)
    for method, curve in table.groupby("method", sort=False):
        ordered = curve if is_text else curve.sort_values("value")
        flux = ordered["photons_per_frame"]
        known = flux.notna()
        # an open interval extends to the end of the curve
        low = ordered["low"].fillna(search.flux_min).where(known)
        high = ordered["high"].fillna(search.flux_max).where(known)
        x = range(len(values)) if is_text else ordered["value"].astype(float)
        look: dict[str, Any] = {"capsize": 2.5, "elinewidth": 1.2, "label": method}
        look |= style.method_style(str(method))
        axes.errorbar(x, flux, np.stack((flux - low, high - flux)), **look)
    axes.set_xlabel(_LABELS.get(sweep.vary, sweep.vary))
    axes.set_ylabel(f"$N_{{{search.bits[0]}b}}$ (photons per frame)")
    axes.label_outer()
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(EngFormatter(sep=""))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_major_locator(LogLocator(numticks=8))
    if axes.get_ylim()[1] < 30 * axes.get_ylim()[0]:  # labels at decades alone would be too few
        axes.yaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
        axes.yaxis.set_minor_formatter(EngFormatter(sep=""))
    if is_text:
        axes.set_xticks(range(len(values)), [str(value) for value in values])
        return
    numbers = [float(value) for value in values]
    if sweep.vary == "search.dark_counts":
        linear_to = min((number for number in numbers if number > 0), default=1.0)
        if min(numbers) > 0:
            axes.set_xscale("log")
        else:
            axes.set_xscale("symlog", linthresh=linear_to)
            axes.set_xlim(left=-0.2 * linear_to)
        axes.xaxis.set_major_formatter("{x:g}")
    elif all(isinstance(value, int) for value in values) and len(values) <= 12:
        axes.set_xticks(numbers)
