"""A sweep as a figure: the flux that each detector needs over the varied parameter."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import EngFormatter, LogLocator, NullFormatter

from megalopta.assets_gen.stimuli import GratingVariant
from megalopta.experiments import ROWS, GratingTemplate, Results, Sweep, Template, Trial, Value
from megalopta.figures.picture import Cell, Figure
from megalopta.figures.style import method_style
from megalopta.flow.metrics import Metric, Threshold, format_flux

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
_VARIANTS: Mapping[GratingVariant, str] = {
    "rot": " (rot, the dissertation's rotation: √2 times as many cycles move, with a seam)",
    "periodic": " (periodic: exactly so many move, without a seam)",
}
_LOGARITHMIC = ("search.dark_counts",)
_MOST_TICKS = 12


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


def bound(end: float | None) -> float:
    """Return an end of an interval as a number, NaN where it is open."""
    return math.nan if end is None else end


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
    for point in sweep.points:
        if sweep.vary == "size" or point.size == size:
            found = threshold_of(results, point.trial, method, metric, bits)
            at_value.setdefault(point.value, []).append(found)
    return [(value, needed(thresholds)) for value, thresholds in at_value.items()]


def sweep_figure(name: str, sweep: Sweep, results: Results, findings: Sequence[str] = ()) -> Figure:
    """Return N_2b, in the first metric, over the varied parameter; a panel for each size.

    Parameters
    ----------
    name : str
        Of the files.
    sweep
    results
        Of its trials.
    findings : sequence of str
        Sentences that these results bear out; the caption has the first.
    """
    sizes = _sizes(sweep)
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
        caption=" ".join([_points(sweep, results), _stimulus(sweep), *findings[:1]]),
        draw=draw,
        columns=COLUMNS,
        rows=tuple(_rows(sweep, results)),
        height_in=4.0 if rows == 1 else 2.8 * rows,
        findings=tuple(findings),
        details=_details(sweep, results),
    )


def _sizes(sweep: Sweep) -> tuple[int, ...]:
    """Return the size of each panel."""
    return (sweep.trial.size,) if sweep.vary == "size" else sweep.sizes or (sweep.trial.size,)


def _points(sweep: Sweep, results: Results) -> str:
    """Say in a sentence what a point is, and where there is none."""
    search = sweep.trial.search
    level = f"{100 * 2.0 ** -search.bits[0]:g} %"
    metric = {"literal": "Eq. 4.5", "ratio": "the quotient of means"}[search.metrics[0]]
    flux = f"the photons per frame at which the error of {metric} falls to {level}"
    text = (
        f"Each point is the mean over {len(sweep.templates)} templates of {flux}, and its bar"
        " reaches from the least to the most of them"
        if len(sweep.templates) > 1
        else f"Each point gives {flux}, with its {100 * search.confidence:g} % interval"
    )
    return f"{text}{_missing(sweep, results)}."


def _stimulus(sweep: Sweep) -> str:
    """Say in a sentence what moves, with the parameters that do not vary."""
    trial = sweep.trial
    pictures = _joined(
        dict.fromkeys(_described(each, sweep.vary) for each in sweep.templates or (trial.template,))
    )
    moving = "" if sweep.vary == "velocity_px" else f" by {trial.velocity_px} px per frame"
    side = "N" if sweep.vary == "size" or len(_sizes(sweep)) > 1 else str(_sizes(sweep)[0])
    dark = (
        f"{trial.search.dark_counts:g} dark counts"
        if sweep.vary != "search.dark_counts"
        else "dark counts"
    )
    parts = [
        f"What moves{moving} is {pictures}",
        f"{dark} per pixel and frame come on top",
        "motion blurs each frame" if trial.blurred and sweep.vary != "blurred" else "",
        f"{trial.search.summed_frames} frames are summed"
        if trial.search.summed_frames > 1 and sweep.vary != "search.summed_frames"
        else "",
        f"all this refers to frames of {ROWS} × {ROWS} px, which are brought to {side} × {side} px",
    ]
    return f"{'; '.join(filter(None, parts))}."


def _joined(texts: Iterable[str]) -> str:
    *first, last = texts
    return f"{', '.join(first)} and {last}" if first else last


def _described(template: Template, vary: str) -> str:
    """Say what a template shows, less what is varied."""
    if not isinstance(template, GratingTemplate):
        if vary == "template.name":
            return "a panorama"
        gray = ", in gray values" if template.coding == "srgb" else ""
        return f"panorama {template.name}{gray}"
    parts = {
        "template.cycles_per_frame": f"{template.cycles_per_frame:g} cycles per frame",
        "template.contrast": f"{100 * template.contrast:g} % contrast",
    }
    of = " and ".join(text for path, text in parts.items() if path != vary)
    return f"a grating of {of}{'' if vary == 'template.variant' else _VARIANTS[template.variant]}"


def _missing(sweep: Sweep, results: Results) -> str:
    """Say which points are missing and why: of any template, in what is drawn."""
    search = sweep.trial.search
    reasons = {
        "undefined": "undefined",
        "above": f"more than {search.flux_max:g} photons",
        "below": f"less than {search.flux_min:g} photons",
    }
    found: dict[tuple[str, str], dict[str, None]] = {}
    for point in sweep.points:
        for method in (each.name for each in sweep.trial.detectors):
            threshold = threshold_of(
                results, point.trial, method, search.metrics[0], search.bits[0]
            )
            if threshold.flux is None:
                at = f"{point.value:g}" if isinstance(point.value, float) else str(point.value)
                where = f"{at} (N = {point.size})" if len(sweep.sizes) > 1 else at
                found.setdefault((method, reasons[threshold.kind]), {})[where] = None
    parts = [f"for {method} at {', '.join(at)} ({why})" for (method, why), at in found.items()]
    if not parts:
        return ""
    of_one = ", in one template or more," if len(sweep.templates) > 1 else ""
    return f"; there is none{of_one} {', '.join(parts)}"


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
            np.arange(len(values)) if _is_text(values) else np.array(values),
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
    bottom, top = axes.get_ylim()
    if top < 30 * bottom:  # a label per decade alone would not tell a number
        steps = (2.0, 5.0) if top > 4 * bottom else (2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0)
        axes.yaxis.set_minor_locator(LogLocator(subs=steps))
        axes.yaxis.set_minor_formatter(EngFormatter(sep=""))
    else:
        axes.yaxis.set_minor_formatter(NullFormatter())


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


def _rows(sweep: Sweep, results: Results) -> Iterator[tuple[Cell, ...]]:
    for point in sweep.points:
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
                    *map(bound, fluxes),
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
            for point in sweep.points
        ],
    }
