"""Page of a calibration: estimates of the pixels, charts, maps, and the figures of EMVA 1288."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import NullFormatter

from megalopta.core.quantities import UNDEFINED, between, percent, with_error
from megalopta.report import style
from megalopta.report.sections import Section, captioned, folded, paragraph, table, write_sections
from megalopta.report.style import BLACK, BLUE, VERMILION, line_style
from megalopta.sensor import Crosstalk, Sensor, changed, load_sensor
from megalopta.sensor.calibrate import crosstalk as estimates, emva as standard
from megalopta.sensor.calibrate.counts import CountingDevice
from megalopta.sensor.calibrate.device import AnalogDevice
from megalopta.sensor.calibrate.emva import Step
from megalopta.sensor.calibrate.pixels import Estimate
from megalopta.sensor.calibrate.recovery import KINDS, DeadTimeEstimate, Recovery

UNKNOWN = "not known"
_PIXELS = (
    "Over pixels: median ± median half width of a pixel's 95 % CI, mean, and range of 90 %. Rates "
    "include crosstalk and afterpulses; maps of the device file do not include those detected."
)
_DROPS = (
    "A point per pixel and level. On the line, noise is that of single events; points of bright "
    "light lie below it where dead time regularizes events."
)
_SATURATION = (
    "Counts of the median pixel. Their distance below the line without dead time gives the dead "
    "time; its kind shows where the two models diverge."
)
_NEIGHBORS = (
    "Chance that an event fires a neighbor, from coincidences in the dark; afterpulses within the "
    "exposure, from the variance of counts, which read noise may hide. Effects above three "
    "standard errors are in the device file. Without a fit, afterpulses come after five dead times."
)
_MAPS = (
    "Grain: scatter of pixels and of their estimates. Gradients: nonuniform light (efficiency) or "
    "temperature (dark counts). Rows and columns: readout. Gray: unknown."
)
_BAD = (
    "Dead: no counts under light; stuck: one reading in all frames (stuck.npy); saturated: at the "
    "counter's end in every recording, or codes without a comb. All are in bad.npy. Hot: clearly "
    "above ten times the median dark counts; telegraph: two rates of dark counts."
)
_FITS = (
    "Deviation of the levels from the curve, pooled over pixels: counts over light and exposure, "
    "rates over light, rates over exposures in the dark. p is the chance of a larger one."
)
_TITLE = "EMVA 1288"
_TEXT = (
    "Release 4, Linear; an event is one electron, a reading a count. The device's figures are "
    "computed from the calibration at 50 steps of light and an exposure of {}. Saturation is "
    "where the temporal variance is largest. R and K are corrected for the calibrated dead time, "
    "the linearity error is not. Dark current is a mean of pixels, with crosstalk and afterpulses."
)
_OF_SUMS = (
    " Of binary frames, figures are of sums of 255: near saturation their variance is below that "
    "of counts, so that K is less than 1 and η too large."
)


class Quantity(NamedTuple):
    """One estimate of every pixel, as the page shows it."""

    name: str
    unit: str
    estimate: Estimate
    scale: float
    """Factor to that unit"""

    @property
    def half_width(self) -> float:
        """Median half width of a pixel's 95 % CI, in that unit; NaN if none is known."""
        widths = self.scale * (self.estimate.high - self.estimate.low) / 2
        return float(np.nanmedian(widths)) if np.isfinite(widths).any() else np.nan

    @property
    def text(self) -> str:
        """Median over pixels with that half width: "315 ± 9 Hz"."""
        return with_error(self.scale * self.estimate.median, self.half_width, self.unit)


def write_page(
    path: Path, summary: str, quantities: Sequence[Quantity], sections: Sequence[Section | None]
) -> None:
    """Write a page: sections, and before the last one maps and values of quantities."""
    rows: list[tuple[str, ...]] = []
    charts = []
    for quantity in quantities:
        title = f"{quantity.name} ({quantity.unit})"
        values = quantity.scale * quantity.estimate.value
        if not np.isfinite(values).any():
            rows.append((quantity.name, UNKNOWN, UNDEFINED, UNDEFINED))
            continue
        low, high = np.nanpercentile(values, (5, 95))
        mean = with_error(float(np.nanmean(values)), 0, quantity.unit)
        rows.append((quantity.name, quantity.text, mean, between(low, high, quantity.unit)))
        charts.append(style.map_chart(values, f"map-{len(rows)}", title))
    head = ("", "median ± 95 % CI of a pixel", "mean", "90 % of the pixels")
    body = folded("Values", table("The pixels", head, rows), paragraph(_PIXELS, "note"))
    pixels = Section("The pixels", _MAPS, charts=tuple(charts), body=body)
    write_sections(
        path, f"Calibration of {path.stem}", summary, [*sections[:-1], pixels, sections[-1]]
    )


def _neighbors_section(
    kernel: estimates.Kernel | None, of_hot_pixels: tuple[Crosstalk, float] | None
) -> Section | None:
    """Return crosstalk to all neighbors by coincidences and by hot pixels, and afterpulses."""
    rows = []
    if kernel is not None:
        value = _fired(kernel.seen) if kernel.seen else f"below {percent(kernel.limit)} each"
        rows.append(("neighbors", value, "yes" if kernel.seen else "no"))
        text = "unknown: bits do not show them"
        if np.isfinite(kernel.afterpulses):
            text = with_error(100 * kernel.afterpulses, 196 * kernel.afterpulses_error, "%")
        rows.append(("afterpulses", text, "yes" if kernel.are_afterpulses_seen else "no"))
    if of_hot_pixels:
        rows.append(("neighbors of hot pixels", _fired(of_hot_pixels), "yes"))
    head = ("", "probability (95 % CI)", "detected")
    return Section("Crosstalk and afterpulses", _NEIGHBORS, head, tuple(rows)) if rows else None


def _fired(talk: tuple[Crosstalk, float]) -> str:
    return with_error(100 * talk[0].mean_fired_neighbors, 196 * talk[1], "%")


def reasons(device: CountingDevice) -> str:
    """Tell what the recordings do not show, and why."""
    return "; ".join(f"{name}: {reason}" for name, reason in device.refused.items())


def parts(
    device: CountingDevice, quantities: Sequence[Quantity], talk: tuple[Crosstalk, float] | None
) -> tuple[str, list[Section | None]]:
    """Return the summary and the sections of a camera."""
    switching = device.telegraph.pixels.sum() if device.telegraph else 0
    summary = ", ".join(f"{quantity.name} {quantity.text}" for quantity in quantities)
    summary = f"{summary[:1].upper()}{summary[1:]} (medians of {device.bad.size} pixels ± 95 % CI)"
    if (dead := device.dead_time) is not None:
        kind = f"{'' if dead.is_kind_clear else 'kind undetermined, taken as '}{dead.recovery.kind}"
        dead_time = with_error(dead.recovery.dead_s, 1.96 * dead.error_s, "s")
        summary += f", dead time {dead_time} ({kind}{_recovers(dead)})"
    if (kernel := device.kernel) is not None and kernel.seen:
        differs = " by direction or parity of lines" if kernel.crosstalk.kernel else ""
        summary += f", crosstalk {_fired(kernel.seen)}{differs}"
    elif kernel is not None and not talk:
        summary += f", crosstalk below {percent(kernel.limit)} per edge neighbor (95 %)"
    telegraph = f", {switching} telegraph" if switching else ""
    summary += f". {device.bad.sum()} pixels are bad, {device.hot.sum()} hot{telegraph}."
    if device.refused:
        summary += f" Not known: {reasons(device)}."
    summary += "".join(
        f" {name.capitalize()}: {misfit}, so intervals do not hold."
        for name, misfit in device.fits.items()
        if misfit.is_clear and name not in device.refused
    )
    kinds = ("dead", "stuck", "saturated", "hot")
    counted = [(kind, str(getattr(device, kind).sum())) for kind in kinds]
    bad = (*counted, ("telegraph", str(switching)))
    bad_pixels = Section("Bad and hot pixels", _BAD, ("", "pixels"), bad)
    fits = tuple((name, str(misfit)) for name, misfit in device.fits.items())
    curves = Section(
        "Goodness of fit", _FITS, ("curve", "all pixels together"), fits, are_words=True
    )
    comb = _comb_section(device) if isinstance(device, AnalogDevice) else None
    return summary, [comb, bad_pixels, curves, _neighbors_section(device.kernel, talk)]


def _recovers(dead: DeadTimeEstimate) -> str:
    """Return what follows the dead time, and what frames do not exclude."""
    text, most = "", []
    for name, word in (("recharge_s", "recharging"), ("twilight_s", "twilight")):
        if seconds := getattr(dead.recovery, name):
            text += f", {word} {with_error(seconds, 0, 's')}"
        if (limit_s := dead.slow_limits.get(name, np.inf)) < dead.recovery.dead_s:
            most.append(f"{word} up to {with_error(limit_s, 0, 's')}")
    if dead.delays_s is not None:
        text += f"; afterpulses after {between(*dead.delays_s, 's')} (95 % CI)"
    if most:
        text += f"; not excluded: {' or '.join(most)}"
    return text


def _comb_section(device: AnalogDevice) -> Section:
    """Return photon transfer, and the saturation curve if there is light, with what they tell."""
    decrease = with_error(100 * device.curve.slope, 196 * device.slope_error, "%")
    seen = "changes" if device.is_slope_seen else "no change seen"
    known = f"{decrease} (95 % CI; {seen})" if np.isfinite(device.slope_error) else UNKNOWN
    text = f"Decrease of the step from top to bottom of the swing: {known}."
    charts = [captioned(_drops_chart(device), _DROPS)]
    if device.efficiency is not None and device.dead_time is not None:
        chart = _saturation_chart(device, device.efficiency.median, device.dead_time.recovery)
        charts.append(captioned(chart, _SATURATION))
    return Section("Photon transfer and saturation", text, charts=tuple(charts))


@style.in_style
def _drops_chart(device: AnalogDevice) -> Markup:
    """Draw variance over mean voltage drop, all pixels at all levels, with the line of the step."""
    figure, axes = style.new_axes(*style.CHART_PT)
    used = device.drops.frames > 0
    dark = (device.drops.light_hz == 0)[:, None] & used
    mean, variance = 1e3 * device.drops.mean_v, 1e6 * device.drops.variance_v2
    look: dict[str, Any] = {"marker": ".", "linewidth": 0, "markersize": 2, "rasterized": True}
    for chosen, color, label in ((dark, style.GRAY, "dark"), (used & ~dark, BLUE, "light")):
        axes.plot(mean[chosen], variance[chosen], color=color, label=label, **look)
    ends = np.array([0.0, float(mean[used].max(initial=1.0))])
    step = 1e3 * device.step_v.median
    axes.plot(ends, step * ends, color=VERMILION, linewidth=1.5, label=f"{step:.3g} mV per event")
    axes.set(xlabel="mean drop of the output (mV)", ylabel="variance (mV²)")
    description = "Photon transfer: variance of readings over their mean"
    return style.with_legend(figure, "transfer", description, markerscale=3)


@style.in_style
def _saturation_chart(device: AnalogDevice, efficiency: float, recovery: Recovery) -> Markup:
    """Draw counts over light at the median pixel, with both models and the line without loss."""
    figure, axes = style.new_axes(*style.CHART_PT)
    lit = device.drops.light_hz > 0
    light, exposure_s = device.drops.light_hz[lit], device.drops.exposure_s[lit]
    counts = np.nanmedian(device.mean_events[lit], axis=1)
    axes.plot(light, counts / exposure_s, "o", color=BLACK, label="measured")
    grid = np.geomspace(light.min(), 1.5 * light.max(), 100)
    dark = device.dark_counts_hz
    rate = (dark.median if dark else 0.0) + efficiency * grid
    axes.plot(grid, rate, ":", color=BLACK, linewidth=1, label="without dead time")
    longest_s = float(exposure_s.max())
    for place, kind in enumerate(KINDS):
        counted = recovery._replace(kind=kind).moments(rate, longest_s)[0]
        axes.plot(grid, counted / longest_s, **line_style(place), label=kind)
    axes.set(xscale="log", yscale="log", xlabel="light (photons/s per pixel)", ylabel="counts/s")
    axes.xaxis.set_minor_formatter(NullFormatter())
    return style.with_legend(figure, "saturation", "Saturation curve: counts over light")


def emva_section(
    device: Path, shape: tuple[int, ...], wavelength_nm: float | None,
    recorded: Sequence[tuple[float, Step]],
) -> Section:  # fmt: skip
    """Return the figures of a device file, and those of the recordings if there are enough.

    `recorded` are exposure (s) and readings of each recording.
    """
    exposures = [exposure_s for exposure_s, step in recorded if step.photons]
    if wavelength_nm is None or not exposures:
        return Section(_TITLE, "Needs recordings of light and --wavelength-nm.")
    exposure_s = max(set(exposures), key=exposures.count)
    sensor = changed(load_sensor(device, Sensor), exposure_s=exposure_s)
    text = _TEXT
    if sensor.counter.capacity == 1:
        exposure_s, text = 255 * exposure_s, _TEXT + _OF_SUMS
        sensor = changed(sensor, exposure_s=exposure_s, counter={"sums": 255})
    at = (shape[0], shape[1]), wavelength_nm
    try:
        figures = [standard.device_emva(sensor, *at)]
    except ValueError as problem:
        return Section(_TITLE, f"Not known: {problem}.")
    seen = [step for time_s, step in recorded if time_s == exposure_s]
    dark, lit = [s for s in seen if not s.photons], [s for s in seen if s.photons]
    if dark and len(lit) >= standard.FEWEST_STEPS:
        factors = standard.without_dead_time(sensor, *at, lit)
        figures.append(standard.emva(dark[0], lit, factors=factors))
    head = ("symbol", "quantity", "device", "recordings")[: 2 + len(figures)]
    text = text.format(with_error(exposure_s, 0, "s"))
    return Section(_TITLE, text, head, standard.rows(*figures), are_words=True)
