"""A sweep as a figure: the flux that each detector needs over the varied parameter."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import EngFormatter, LogLocator

from megalopta.benchmark.panoramas import ROWS
from megalopta.benchmark.runner import Results
from megalopta.benchmark.trial import GratingTemplate, Sweep, Trial, Value
from megalopta.flow.metrics.photon_threshold import Threshold, format_flux
from megalopta.flow.metrics.response_error import Metric
from megalopta.report.style import method_style
from megalopta.reproduction.picture import Cell, Figure, columns_of, draw_interval, log_decades

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
_LOGARITHMIC = ("search.dark_counts",)
_MOST_TICKS = 12


class MeanThreshold(NamedTuple):
    """Photons per frame at one value of a sweep; NaN if not all templates have a threshold.

    For one template the bounds are its confidence interval, for several the least and the most.
    None is an open end of an interval, beyond the curve.
    """

    flux: float
    low: float | None
    high: float | None
    interval: str
    """Bounds as text"""


def mean_threshold(thresholds: Sequence[Threshold]) -> MeanThreshold:
    """Return the mean over templates, and bounds."""
    if any(each.flux is None for each in thresholds):
        return MeanThreshold(math.nan, math.nan, math.nan, "")
    fluxes = [float(each.flux or math.nan) for each in thresholds]
    if len(fluxes) > 1:
        low, high = min(fluxes), max(fluxes)
        interval = f"[{format_flux(low)}, {format_flux(high)}]"
        return MeanThreshold(float(np.mean(fluxes)), low, high, interval)
    (only,) = thresholds
    return MeanThreshold(fluxes[0], only.low, only.high, only.interval)


def threshold_of(
    results: Results, trial: Trial, method: str, metric: Metric, bits: int
) -> Threshold:
    """Return the threshold of one detector in one trial."""
    for curve in results[trial]:
        if (curve.method, curve.metric) == (method, metric):
            return curve.thresholds[bits]
    raise KeyError(f"{method}, {metric}")


def sweep_curve(
    sweep: Sweep, results: Results, size: int, method: str, metric: Metric, bits: int = 2
) -> list[tuple[Value, MeanThreshold]]:
    """Return the thresholds of one detector at each value of a sweep, at one size."""
    at_value: dict[Value, list[Threshold]] = {}
    for point in sweep.points:
        if sweep.vary == "size" or point.size == size:
            found = threshold_of(results, point.trial, method, metric, bits)
            at_value.setdefault(point.value, []).append(found)
    return [(value, mean_threshold(thresholds)) for value, thresholds in at_value.items()]


def or_nan(flux: float | None) -> float:
    """Return a flux or bound as a number; NaN if there is none."""
    return math.nan if flux is None else flux


def sweep_figure(
    name: str,
    sweep: Sweep,
    results: Results,
    printed: Mapping[str, tuple[str, str]] | None = None,
) -> Figure:
    """Draw N_2b, in the first metric, over the varied parameter; a panel per size.

    `printed` are numbers of these results and of the dissertation.
    """
    rows = math.ceil(len(_sizes(sweep)) / 2)
    trials = [
        {
            "size": point.size,
            "value": point.value,
            "template": point.template,
            "curves": [curve.to_dict() for curve in results[point.trial]],
        }
        for point in sweep.points
    ]
    return Figure(
        name=name,
        title=sweep.title,
        caption=_caption(sweep, results),
        draw=partial(_draw, sweep=sweep, results=results),
        numbers=columns_of(_rows(sweep, results)),
        height_in=4.0 if rows == 1 else 2.8 * rows,
        printed=printed or {},
        details={"sweep": sweep.model_dump(mode="json"), "trials": trials},
    )


def _sizes(sweep: Sweep) -> tuple[int, ...]:
    """Return the size of each panel."""
    return (sweep.trial.size,) if sweep.vary == "size" else sweep.sizes or (sweep.trial.size,)


def _caption(sweep: Sweep, results: Results) -> str:
    search, templates = sweep.trial.search, sweep.templates
    metric = {"literal": "Eq. 4.5", "ratio": "the quotient of means"}[search.metrics[0]]
    bars = f"{100 * search.confidence:g} % intervals"
    if len(templates) > 1:
        bars = f"the range over {len(templates)} templates"
    missing = _missing(sweep, results)
    return (
        f"N_{search.bits[0]}b is the photons per frame at which the error of {metric} falls to "
        f"{100 * 2.0 ** -search.bits[0]:g} %; bars are {bars}. Fixed, for frames of "
        f"{ROWS} × {ROWS} px: {', '.join(_fixed(sweep))}. Points without N_{search.bits[0]}b: "
        f"{', '.join(f'{name} {count}' for name, count in missing.items()) or 'none'}."
    )


def _fixed(sweep: Sweep) -> Iterator[str]:
    """Yield the fixed settings of all trials, by their names in a sweep's file."""
    trial, pictures = sweep.trial, sweep.templates or (sweep.trial.template,)
    fixed: dict[str, object] = {"velocity_px": trial.velocity_px}
    if isinstance(template := pictures[0], GratingTemplate):
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


def _missing(sweep: Sweep, results: Results) -> Counter[str]:
    """Return the number of points without threshold of each method in the figure."""
    search = sweep.trial.search
    return Counter(
        method
        for point in sweep.points
        for method in (each.name for each in sweep.trial.detectors)
        if threshold_of(results, point.trial, method, search.metrics[0], search.bits[0]).flux
        is None
    )


def _draw(canvas: Canvas, sweep: Sweep, results: Results) -> None:
    sizes = _sizes(sweep)
    shape = math.ceil(len(sizes) / 2), min(len(sizes), 2)
    panels = canvas.subplots(*shape, sharex=True, sharey=True, squeeze=False).ravel()
    for axes, size in zip(panels, sizes, strict=False):
        _draw_panel(axes, sweep, results, size)
        if len(sizes) > 1:
            axes.set_title(f"N = {size}", loc="left")
    for axes in panels[len(sizes) :]:
        axes.set_axis_off()
    canvas.legend(*panels[0].get_legend_handles_labels(), loc="outside right center")


def _draw_panel(axes: Axes, sweep: Sweep, results: Results, size: int) -> None:
    search = sweep.trial.search
    values: list[Value] = []
    for method in (each.name for each in sweep.trial.detectors):
        curve = sweep_curve(sweep, results, size, method, search.metrics[0], search.bits[0])
        if not _is_text([value for value, _ in curve]):
            curve.sort(key=lambda point: float(point[0]))
        values = [value for value, _ in curve]
        flux = np.array([each.flux for _, each in curve])
        # an open interval extends to the end of the curve
        low = np.array([search.flux_min if each.low is None else each.low for _, each in curve])
        high = np.array([search.flux_max if each.high is None else each.high for _, each in curve])
        x = range(len(values)) if _is_text(values) else values
        look = {"capsize": 2.5, "elinewidth": 1.2, "label": method, **method_style(method)}
        draw_interval(axes, x, flux, (low, high), **look)
    axes.set_xlabel(_LABELS.get(sweep.vary, sweep.vary))
    axes.set_ylabel(f"$N_{{{search.bits[0]}b}}$ (photons per frame)")
    axes.label_outer()
    _scale_photons(axes)
    _scale_values(axes, values, sweep.vary in _LOGARITHMIC)


def _scale_photons(axes: Axes) -> None:
    log_decades(axes, "y")
    axes.yaxis.set_major_locator(LogLocator(numticks=8))
    bottom, top = axes.get_ylim()
    if top < 30 * bottom:  # labels at decades alone would be too few
        steps = (2.0, 5.0) if top > 4 * bottom else tuple(np.arange(2.0, 10.0))
        axes.yaxis.set_minor_locator(LogLocator(subs=steps))
        axes.yaxis.set_minor_formatter(EngFormatter(sep=""))


def _scale_values(axes: Axes, values: Sequence[Value], is_logarithmic: bool) -> None:
    if _is_text(values):
        axes.set_xticks(range(len(values)), [str(value) for value in values])
        return
    numbers = [float(value) for value in values]
    if is_logarithmic:
        linear_to = min((each for each in numbers if each > 0), default=1.0)
        if min(numbers) > 0:
            axes.set_xscale("log")
        else:
            axes.set_xscale("symlog", linthresh=linear_to)
            axes.set_xlim(left=-0.2 * linear_to)
        axes.xaxis.set_major_formatter("{x:g}")
    elif all(isinstance(value, int) for value in values) and len(values) <= _MOST_TICKS:
        axes.set_xticks(numbers)


def _is_text(values: Sequence[Value]) -> bool:
    return any(isinstance(value, (str, bool)) for value in values)


def _rows(sweep: Sweep, results: Results) -> Iterator[dict[str, Cell]]:
    for point in sweep.points:
        for curve in results[point.trial]:
            for bits, found in curve.thresholds.items():
                yield {
                    "size_px": point.trial.size,
                    "value": point.value,
                    "template": point.template,
                    "method": curve.method,
                    "metric": curve.metric,
                    "bits": bits,
                    "kind": found.kind,
                    "photons_per_frame": or_nan(found.flux),
                    "low": or_nan(found.low),
                    "high": or_nan(found.high),
                }
