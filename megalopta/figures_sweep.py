"""A sweep as a figure: the flux that each detector needs over the varied parameter."""

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import EngFormatter, LogLocator, NullFormatter

from megalopta.engine import Results
from megalopta.figure import Cell, Figure
from megalopta.flow.error import Metric
from megalopta.flow.threshold import Threshold, format_flux
from megalopta.plot_style import method_style
from megalopta.sweep import Sweep, Value
from megalopta.trial import Trial

CAPTION = (
    "Flux at which the error falls below the level of so many bits, with its interval; over"
    " several templates the mean, with the least and the most."
)
COLUMNS = (
    "size_px",
    "value",
    "template",
    "method",
    "metric",
    "bits",
    "kind",
    "photons_per_frame",
    "low",
    "high",
)
_LABELS = {
    "template.cycles_per_frame": "Cycles per frame",
    "template.contrast": "Michelson contrast",
    "search.dark_counts": "Dark counts per pixel",
    "search.summed_frames": "Frames summed",
    "velocity_px": "Velocity (px per frame)",
    "size": "Pooling N (px)",
}
_LOGARITHMIC = ("search.dark_counts",)


class Needed(NamedTuple):
    """Photons per frame at one value of a sweep; NaN where not all templates have a threshold.

    Of one template the bounds are its confidence interval, of several the least and the most. An
    end at which the interval is open, beyond the curve, is None.
    """

    flux: float
    low: float | None
    high: float | None
    interval: str
    """The bounds in print"""


def needed(thresholds: Sequence[Threshold]) -> Needed:
    """Return the mean over templates, and bounds."""
    if any(each.flux is None for each in thresholds):
        return Needed(math.nan, math.nan, math.nan, "")
    fluxes = [float(each.flux or math.nan) for each in thresholds]
    if len(fluxes) > 1:
        low, high = min(fluxes), max(fluxes)
        interval = f"[{format_flux(low)}, {format_flux(high)}]"
        return Needed(float(np.mean(fluxes)), low, high, interval)
    (only,) = thresholds
    return Needed(fluxes[0], only.low, only.high, only.interval)


def threshold_of(
    results: Results, trial: Trial, method: str, metric: Metric, bits: int
) -> Threshold:
    """Return what one detector needs in one trial."""
    for curve in results[trial]:
        if (curve.method, curve.metric) == (method, metric):
            return curve.thresholds[bits]
    raise KeyError(f"{method}, {metric}")


def sweep_curve(
    sweep: Sweep, results: Results, size: int, method: str, metric: Metric, bits: int = 2
) -> list[tuple[Value, Needed]]:
    """Return what one detector needs at each value of a sweep, at one size."""
    at_value: dict[Value, list[Threshold]] = {}
    for point in sweep.points():
        if sweep.vary == "size" or point.size == size:
            found = threshold_of(results, point.trial, method, metric, bits)
            at_value.setdefault(point.value, []).append(found)
    return [(value, needed(thresholds)) for value, thresholds in at_value.items()]


def sweep_figure(name: str, sweep: Sweep, results: Results, caption: str) -> Figure:
    """Return N_2b, in the first metric, over the varied parameter; a panel for each size."""
    sizes = (sweep.trial.size,) if sweep.vary == "size" else sweep.sizes or (sweep.trial.size,)
    rows = math.ceil(len(sizes) / 2)

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(
            rows, min(len(sizes), 2), sharex=True, sharey=True, squeeze=False
        ).ravel()
        for axes, size in zip(panels, sizes, strict=False):
            _draw_panel(axes, sweep, results, size)
            if len(sizes) > 1:
                axes.set_title(f"N = {size}", loc="left")
        for axes in panels[len(sizes) :]:
            axes.set_axis_off()
        handles, labels = panels[0].get_legend_handles_labels()
        canvas.legend(handles, labels, loc="outside right center")

    return Figure(
        name=name,
        title=sweep.title,
        caption=caption,
        draw=draw,
        columns=COLUMNS,
        rows=tuple(_rows(sweep, results)),
        height_in=4.0 if rows == 1 else 2.8 * rows,
        details=_details(sweep, results),
    )


def _draw_panel(axes: Axes, sweep: Sweep, results: Results, size: int) -> None:
    metric = sweep.trial.search.metrics[0]
    names = sweep.trial.methods
    for method in names:
        curve = sweep_curve(sweep, results, size, method, metric, sweep.trial.search.bits[0])
        x = np.arange(len(curve)) if _is_text(sweep) else np.array([value for value, _ in curve])
        search = sweep.trial.search  # an open interval reaches to the end of the curve
        flux = np.array([each.flux for _, each in curve])
        low = np.array([search.flux_min if each.low is None else each.low for _, each in curve])
        high = np.array([search.flux_max if each.high is None else each.high for _, each in curve])
        axes.errorbar(
            x,
            flux,
            (flux - low, high - flux),
            capsize=2.5,
            elinewidth=1.2,
            label=method,
            **method_style(method),
        )
    axes.set_xlabel(_LABELS.get(sweep.vary, sweep.vary))
    axes.set_ylabel(f"$N_{{{sweep.trial.search.bits[0]}b}}$ (photons per frame)")
    axes.label_outer()
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(numticks=8))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_major_formatter(EngFormatter(sep=""))
    if sweep.vary in _LOGARITHMIC:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
    elif _is_text(sweep):
        axes.set_xticks(range(len(sweep.values)), [str(value) for value in sweep.values])
    elif all(isinstance(value, int) for value in sweep.values):
        axes.set_xticks([float(value) for value in sweep.values])


def _is_text(sweep: Sweep) -> bool:
    return any(isinstance(value, str) for value in sweep.values)


def _rows(sweep: Sweep, results: Results) -> Iterator[tuple[Cell, ...]]:
    for point in sweep.points():
        for curve in results[point.trial]:
            for bits, found in curve.thresholds.items():
                fluxes = (found.flux, found.low, found.high)
                yield (
                    point.trial.size,
                    point.value,
                    point.template,
                    curve.method,
                    curve.metric,
                    bits,
                    found.kind,
                    *(math.nan if each is None else each for each in fluxes),
                )


def _details(sweep: Sweep, results: Results) -> dict[str, Any]:
    return {
        "sweep": sweep.model_dump(mode="json"),
        "trials": [
            {
                "size": point.size,
                "value": point.value,
                "template": point.template,
                "curves": [curve.to_dict() for curve in results[point.trial]],
            }
            for point in sweep.points()
        ],
    }
