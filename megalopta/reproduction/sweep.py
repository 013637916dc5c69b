"""A sweep as a figure: the flux that each detector needs over the varied parameter."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import EngFormatter, LogLocator, NullFormatter

from megalopta.benchmark.runner import Results
from megalopta.benchmark.sweep import Sweep, Value
from megalopta.plotting.picture import Cell, Figure, columns_of
from megalopta.plotting.style import method_style
from megalopta.reproduction.sweep_caption import panel_sizes, points, stimulus
from megalopta.reproduction.thresholds import or_nan, sweep_curve

_LABELS = {
    "template.cycles_per_frame": "Cycles per frame",
    "template.contrast": "Michelson contrast",
    "search.dark_counts": "Dark counts per pixel",
    "search.summed_frames": "Frames summed",
    "velocity_px": "Velocity (px per frame)",
    "size": "Pooling N (px)",
}
_LOGARITHMIC = ("search.dark_counts",)
_MOST_TICKS = 12


def sweep_figure(name: str, sweep: Sweep, results: Results, findings: Sequence[str] = ()) -> Figure:
    """Return N_2b, in the first metric, over the varied parameter; a panel for each size.

    The caption has the first of the findings, sentences that these results bear out.
    """
    sizes = panel_sizes(sweep)
    rows = math.ceil(len(sizes) / 2)

    def draw(canvas: Canvas) -> None:
        shape = rows, min(len(sizes), 2)
        panels = canvas.subplots(*shape, sharex=True, sharey=True, squeeze=False).ravel()
        for axes, size in zip(panels, sizes, strict=False):
            _draw_panel(axes, sweep, results, size)
            if len(sizes) > 1:
                axes.set_title(f"N = {size}", loc="left")
        for axes in panels[len(sizes) :]:
            axes.set_axis_off()
        canvas.legend(*panels[0].get_legend_handles_labels(), loc="outside right center")

    return Figure(
        name=name,
        title=sweep.title,
        caption=" ".join([points(sweep, results), stimulus(sweep), *findings[:1]]),
        draw=draw,
        numbers=columns_of(_rows(sweep, results)),
        height_in=4.0 if rows == 1 else 2.8 * rows,
        findings=tuple(findings),
        details={
            "sweep": sweep.model_dump(mode="json"),
            "trials": [
                {
                    "size": point.size,
                    "value": point.value,
                    "template": point.template,
                    "curves": [curve.to_dict() for curve in results[point.trial]],
                }
                for point in sweep.points
            ],
        },
    )


def _draw_panel(axes: Axes, sweep: Sweep, results: Results, size: int) -> None:
    search = sweep.trial.search
    values: list[Value] = []
    for method in (each.name for each in sweep.trial.detectors):
        curve = sweep_curve(sweep, results, size, method, search.metrics[0], search.bits[0])
        if not _is_text([value for value, _ in curve]):
            curve.sort(key=lambda point: float(point[0]))
        values = [value for value, _ in curve]
        flux = np.array([each.flux for _, each in curve])
        # an open interval reaches to the end of the curve
        low = np.array([search.flux_min if each.low is None else each.low for _, each in curve])
        high = np.array([search.flux_max if each.high is None else each.high for _, each in curve])
        axes.errorbar(
            range(len(values)) if _is_text(values) else values,
            flux,
            (flux - low, high - flux),
            capsize=2.5,
            elinewidth=1.2,
            label=method,
            **method_style(method),
        )
    axes.set_xlabel(_LABELS.get(sweep.vary, sweep.vary))
    axes.set_ylabel(f"$N_{{{search.bits[0]}b}}$ (photons per frame)")
    axes.label_outer()
    _scale_photons(axes)
    _scale_values(axes, values, sweep.vary in _LOGARITHMIC)


def _scale_photons(axes: Axes) -> None:
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(numticks=8))
    axes.yaxis.set_major_formatter(EngFormatter(sep=""))
    axes.yaxis.set_minor_formatter(NullFormatter())
    bottom, top = axes.get_ylim()
    if top < 30 * bottom:  # a label per decade alone would not tell a number
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
