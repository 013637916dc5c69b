"""Page of a calibration: estimates of the pixels, charts, maps, and the figures of EMVA 1288."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import NullFormatter

from megalopta.core.quantities import UNDEFINED, number, percent, with_error
from megalopta.report import style
from megalopta.report.sections import Section, captioned, folded, paragraph, table, write_sections
from megalopta.report.style import BLACK, BLUE, VERMILION, line_style
from megalopta.sensor import Crosstalk, Sensor, changed, load_sensor
from megalopta.sensor.calibrate import crosstalk as estimates, emva as standard, saturation
from megalopta.sensor.calibrate.counts import CountingDevice
from megalopta.sensor.calibrate.device import Device, Estimate
from megalopta.sensor.calibrate.emva import Step

UNKNOWN = "not known"
_PIXELS = (
    "Median over pixels ± median half width of a pixel's 95 % CI, and range of 90 % of them. Rates "
    "include crosstalk and afterpulses; maps of the device file exclude those found below."
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
    "Probability that an event fires a neighbor, from coincidences in the dark; afterpulses within "
    "the exposure, from the variance of dark counts, which read noise may hide. Effects above "
    "three standard errors are in the device file; the delay is assumed to be five dead times."
)
_MAPS = (
    "Grain: scatter of pixels and of their estimates. Gradients: nonuniform light (efficiency) or "
    "temperature (dark counts). Rows and columns: readout. Gray: unknown."
)
_BAD = (
    "Dead: no counts under light; stuck: one reading in all frames; saturated: at the counter's "
    "end in every recording; these are in bad.npy, readings that do not change in stuck.npy. Hot: "
    "significantly above ten times the median dark counts; telegraph: two rates of dark counts."
)
_TITLE = "EMVA 1288"
_TEXT = (
    "Release 4, Linear; an event is one electron, a reading a count. The device's figures are "
    "computed from the calibration at 50 steps of light and an exposure of {}. Saturation is "
    "where the temporal variance is largest. R and K are corrected for the calibrated dead time, "
    "the linearity error is not. Dark current includes crosstalk and afterpulses."
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
            rows.append((quantity.name, UNKNOWN, UNDEFINED))
            continue
        low, high = np.nanpercentile(values, (5, 95))
        rows.append((quantity.name, quantity.text, f"{number(low)} to {number(high)}"))
        charts.append(style.map_chart(values, f"map-{len(rows)}", title))
    head = ("", "median ± 95 % CI of a pixel", "90 % of the pixels")
    body = folded("Values", table("The pixels", head, rows), paragraph(_PIXELS, "note"))
    pixels = Section("The pixels", _MAPS, charts=tuple(charts), body=body)
    write_sections(
        path, f"Calibration of {path.stem}", summary, [*sections[:-1], pixels, sections[-1]]
    )


def neighbors_section(
    kernel: estimates.Kernel | None, of_hot_pixels: float = 0.0
) -> Section | None:
    """Return crosstalk to all neighbors by coincidences and by hot pixels (%), and afterpulses."""
    rows = []
    if kernel is not None:
        pulses = kernel.afterpulses, kernel.afterpulses_error
        for name, share, error, is_seen in (
            ("neighbors", 2 * kernel.share.sum(), kernel.total_error, kernel.is_seen),
            ("afterpulses", *pulses, kernel.are_afterpulses_seen),
        ):
            text = UNKNOWN if np.isnan(share) else with_error(100 * share, 196 * error, "%")
            rows.append((name, text, "yes" if is_seen else "no"))
    if of_hot_pixels:
        rows.append(("neighbors of hot pixels", with_error(of_hot_pixels, 0, "%"), "yes"))
    head = ("", "probability (95 % CI)", "detected")
    return Section("Crosstalk and afterpulses", _NEIGHBORS, head, tuple(rows)) if rows else None


def medians(quantities: Sequence[Quantity]) -> str:
    """Return the medians in a line."""
    text = ", ".join(f"{quantity.name} {quantity.text}" for quantity in quantities)
    return f"{text[:1].upper()}{text[1:]}"


def reasons(device: CountingDevice) -> str:
    """Tell what the recordings do not show, and why."""
    return "; ".join(f"{name}: {reason}" for name, reason in device.refused.items())


def counting_parts(
    device: CountingDevice, quantities: Sequence[Quantity], talk: Crosstalk | None
) -> tuple[str, list[Section | None]]:
    """Return the summary and the sections of a camera of counts or bits."""
    switching = device.telegraph.pixels.sum() if device.telegraph else 0
    summary = medians(quantities)
    if (dead := device.dead_time) is not None:
        kind = dead.kind if dead.is_kind_clear else f"kind undetermined, taken as {dead.kind}"
        dead_time = with_error(dead.seconds, 1.96 * dead.error, "s")
        summary += f", dead time {dead_time} ({kind})"
    summary += (
        f". These are medians of {device.bad.size} pixels ± 95 % CI of a pixel; {device.bad.sum()} "
        f"pixels are bad, {device.hot.sum()} hot{f', {switching} telegraph' if switching else ''}."
    )
    if device.refused:
        summary += f" Not known: {reasons(device)}."
    kinds = ("dead", "stuck", "saturated", "hot")
    counted = [(kind, str(getattr(device, kind).sum())) for kind in kinds]
    bad = (*counted, ("telegraph", str(switching)))
    hot_percent = 100 * talk.mean_fired_neighbors if talk else 0.0
    found = Section("Bad and hot pixels", _BAD, ("", "pixels"), bad)
    return summary, [found, neighbors_section(device.kernel, hot_percent)]


def curves_section(device: Device) -> Section:
    """Return photon transfer, and under light the saturation curve, with what they determine."""
    decrease = with_error(100 * device.curve.slope, 196 * device.slope_error, "%")
    seen = "changes" if device.is_slope_seen else "no change seen"
    known = f"{decrease} (95 % CI; {seen})" if np.isfinite(device.slope_error) else UNKNOWN
    text = f"Decrease of the step from top to bottom of the swing: {known}."
    if device.misfit:
        share = f"{100 * device.misfit:+.2g} %"
        text += f" Counts differ from the curves of both kinds of dead time by {share}."
    elif device.dead_time_kind is None:
        text += f" Kind of dead time: {UNKNOWN}; record brighter light."
    charts = [captioned(_drops_chart(device), _DROPS)]
    if device.efficiency is not None and device.dead_time_s is not None:
        chart = _saturation_chart(device, device.efficiency, device.dead_time_s)
        charts.append(captioned(chart, _SATURATION))
    return Section("Photon transfer and saturation", text, charts=tuple(charts))


def curve_fits(device: Device) -> list[str]:
    """Return how far counts are from each curve: "within 0.2 % of the paralyzable curve".

    It is the largest deviation of a light's counts over all pixels, at the fitted dead time.
    """
    if device.efficiency is None or device.dead_time_s is None:
        return []
    lit = device.counts.light_hz > 0
    light_hz, exposure_s = device.counts.light_hz[lit, None], device.counts.exposure_s[lit, None]
    rates = (device.dark_counts_hz, device.efficiency, device.dead_time_s)
    dark_hz, efficiency, dead_s = (rate.value.ravel() for rate in rates)
    known = np.isfinite(dark_hz + efficiency + dead_s) & (device.drops.frames[lit] > 0)
    texts = []
    for kind in sorted(saturation.KINDS, key=lambda kind: kind != device.dead_time_kind):
        rate_hz = np.where(known, dark_hz + efficiency * light_hz, 0.0)
        dead = np.where(known, dead_s, 0.0)
        model = saturation.dead_time_moments(rate_hz, exposure_s, dead, kind)[0].sum(axis=1)
        measured = np.where(known, device.counts.mean[lit], 0).sum(axis=1)
        texts.append(f"within {percent(abs(measured / model - 1).max())} of the {kind} curve")
    return texts


@style.in_style
def _drops_chart(device: Device) -> Markup:
    """Draw variance over mean voltage drop, all pixels at all levels, with the line of the step."""
    figure, axes = style.new_axes(*style.CHART_PT)
    used = device.drops.frames > 0
    dark = (device.counts.light_hz == 0)[:, None] & used
    mean, variance = 1e3 * device.drops.mean_v, 1e6 * device.drops.variance_v2
    for chosen, color, label in ((dark, BLACK, "dark"), (used & ~dark, BLUE, "light")):
        axes.plot(mean[chosen], variance[chosen], ".", color=color, markersize=2, label=label)
    ends = np.array([0.0, float(mean[used].max(initial=1.0))])
    step = 1e3 * device.step_v.median
    axes.plot(ends, step * ends, color=VERMILION, linewidth=1.5, label=f"{step:.3g} mV per event")
    axes.set(xlabel="mean drop of the output (mV)", ylabel="variance (mV²)")
    description = "Photon transfer: variance of readings over their mean"
    return style.with_legend(figure, "transfer", description, markerscale=3)


@style.in_style
def _saturation_chart(device: Device, efficiency: Estimate, dead_time_s: Estimate) -> Markup:
    """Draw counts over light at the median pixel, with both models and the line without loss."""
    figure, axes = style.new_axes(*style.CHART_PT)
    lit = device.counts.light_hz > 0
    light, exposure = device.counts.light_hz[lit], device.counts.exposure_s[lit]
    mean = np.where(device.drops.frames[lit] > 0, device.counts.mean[lit], np.nan)
    axes.plot(light, np.nanmedian(mean, axis=1) / exposure, "o", color=BLACK, label="measured")
    grid = np.geomspace(light.min(), 1.5 * light.max(), 100)
    rate = device.dark_counts_hz.median + efficiency.median * grid
    axes.plot(grid, rate, ":", color=BLACK, linewidth=1, label="without dead time")
    tau = np.full(rate.shape, dead_time_s.median)
    for place, kind in enumerate(saturation.KINDS):
        counted = saturation.dead_time_moments(rate, exposure.max(), tau, kind)[0]
        axes.plot(grid, counted / exposure.max(), **line_style(place), label=kind)
    axes.set(xscale="log", yscale="log", xlabel="light (photons/s per pixel)", ylabel="counts/s")
    axes.xaxis.set_minor_formatter(NullFormatter())
    return style.with_legend(figure, "saturation", "Saturation curve: counts over light")


def emva_section(
    device: Path,
    shape: tuple[int, ...],
    wavelength_nm: float | None,
    recorded: Sequence[tuple[float, Step]],
) -> Section:
    """Return the figures of a device file, and those of the recordings if there are enough.

    `recorded` are exposure (s) and readings of each recording.
    """
    exposures = [exposure_s for exposure_s, step in recorded if step.photons]
    if wavelength_nm is None or not exposures:
        return Section(_TITLE, "Needs recordings of light and --wavelength-nm.")
    exposure_s = max(set(exposures), key=exposures.count)
    sensor = changed(load_sensor(device, Sensor), exposure_s=exposure_s)
    if sensor.counter.capacity == 1:
        return Section(_TITLE, "Needs counts: sum binary frames, 255 or more each.")
    at = (shape[0], shape[1]), wavelength_nm
    try:
        figures = [standard.device_emva(sensor, *at)]
    except ValueError as problem:
        return Section(_TITLE, f"Not known: {problem}.")
    seen = [step for time_s, step in recorded if time_s == exposure_s]
    darkest, lit = min(seen, key=lambda step: step.photons), [s for s in seen if s.photons]
    if not darkest.photons and len(lit) >= standard.FEWEST_STEPS:
        factors = standard.without_dead_time(sensor, *at, lit)
        figures.append(standard.emva(darkest, lit, factors=factors))
    head = ("symbol", "quantity", "device", "recordings")[: 2 + len(figures)]
    text = _TEXT.format(with_error(exposure_s, 0, "s"))
    return Section(_TITLE, text, head, standard.rows(*figures))
