"""Page of a calibration: estimates of the pixels, charts, maps, and the figures of EMVA 1288."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import NullFormatter

from megalopta.core.errors import UserError
from megalopta.core.quantities import UNDEFINED, between, percent, with_error
from megalopta.report import style
from megalopta.report.sections import Section, captioned, paragraph, table, write_sections
from megalopta.sensor import Crosstalk, Sensor, changed, load_sensor
from megalopta.sensor.calibrate import crosstalk as estimates, emva as standard
from megalopta.sensor.calibrate.counts import CountingDevice
from megalopta.sensor.calibrate.device import AnalogDevice
from megalopta.sensor.calibrate.pixels import Quantity
from megalopta.sensor.calibrate.recovery import KINDS, Recovery

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
    "From coincidences in the dark; afterpulses from the variance of counts, which read noise may "
    "hide. Effects above three standard errors are in the device file."
)
_MAPS = (
    "Grain: scatter of pixels and of their estimates. Gradients: nonuniform light (efficiency) or "
    "temperature (dark counts). Rows and columns: readout. Gray: unknown."
)
_BAD = (
    "In bad.npy: dead, stuck at one reading, and saturated in every recording, or without a comb. "
    "Hot: above ten times the median dark counts; telegraph: two rates of dark counts."
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


def write_page(
    path: Path, summary: str, quantities: Sequence[Quantity], sections: Sequence[Section | None]
) -> None:
    """Write a page: sections, and before the last one maps and values of quantities."""
    rows: list[tuple[str, ...]] = []
    charts = []
    for quantity in quantities:
        title, estimate = f"{quantity.name} ({quantity.unit})", quantity.estimate
        values = quantity.scale * quantity.estimate.value
        if not np.isfinite(values).any():
            rows.append((quantity.name, UNKNOWN, UNDEFINED, UNDEFINED))
            continue
        low, high = np.nanpercentile(values, (5, 95))
        mean = with_error(float(np.nanmean(values)), 0, quantity.unit)
        rows.append((quantity.name, quantity.text, mean, between(low, high, quantity.unit)))
        charts.append(style.map_chart(values, f"map-{len(rows)}", title))
        half = quantity.scale * (estimate.high - estimate.low) / 2
        charts.append(style.map_chart(half, f"half-{len(rows)}", f"± 95 % CI of {title}"))
    head = ("", "median ± 95 % CI of a pixel", "mean", "90 % of the pixels")
    body = table("The pixels", head, rows) + paragraph(_PIXELS, "note")
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
        limit = f"below {percent(kernel.limit)} each"
        value = estimates.text_of(kernel.seen) if kernel.seen else limit
        rows.append(("neighbors", value, "yes" if kernel.seen else "no"))
        text = "unknown: bits do not show them"
        if np.isfinite(kernel.afterpulses):
            text = with_error(100 * kernel.afterpulses, 196 * kernel.afterpulses_error, "%")
        rows.append(("afterpulses", text, "yes" if kernel.are_afterpulses_seen else "no"))
    if of_hot_pixels:
        rows.append(("neighbors of hot pixels", estimates.text_of(of_hot_pixels), "yes"))
    head = ("", "probability (95 % CI)", "detected")
    return Section("Crosstalk and afterpulses", _NEIGHBORS, head, tuple(rows)) if rows else None


def parts(device: CountingDevice, talk: tuple[Crosstalk, float] | None) -> list[Section | None]:
    """Return the sections of a camera."""
    kinds = ("dead", "stuck", "saturated", "hot")
    counted = [(kind, str(getattr(device, kind).sum())) for kind in kinds]
    switching = device.telegraph.pixels.sum() if device.telegraph else 0
    bad = (*counted, ("telegraph", str(switching)))
    fits = tuple((name, str(misfit)) for name, misfit in device.fits.items())
    return [
        _curves_section(device),
        Section("Bad and hot pixels", _BAD, ("", "pixels"), bad),
        Section("Goodness of fit", _FITS, ("curve", "all pixels together"), fits, are_words=True),
        _neighbors_section(device.kernel, talk),
    ]


def _curves_section(device: CountingDevice) -> Section | None:
    """Return photon transfer, and the saturation curve if dead time is known; None of bits."""
    if device.recordings[0].is_binary:
        return None
    rows, charts = [], [captioned(_transfer_chart(device), _DROPS)]
    if isinstance(device, AnalogDevice):
        decrease = with_error(100 * device.curve.slope, 196 * device.slope_error, "%")
        seen = "changes" if device.is_slope_seen else "no change seen"
        known = f"{decrease} (95 % CI; {seen})" if np.isfinite(device.slope_error) else UNKNOWN
        rows.append(("decrease of the step from top to bottom of the swing", known))
    if (dead := device.dead_time) is not None:
        rows.append(("dead time", f"{dead}"))
        if device.efficiency is not None:
            chart = _saturation_chart(device, device.efficiency.median, dead.recovery)
            charts.append(captioned(chart, _SATURATION))
    title, head = "Photon transfer and saturation", ("", "of all pixels (95 % CI)") if rows else ()
    return Section(title, "", head, tuple(rows), True, charts=tuple(charts))


@style.in_style
def _transfer_chart(device: CountingDevice) -> Markup:
    """Draw variance over mean, all pixels at all levels, with the line of single events."""
    figure, axes = style.new_axes(*style.CHART_PT)
    look: dict[str, Any] = {"marker": ".", "linewidth": 0, "markersize": 2, "rasterized": True}
    if isinstance(device, AnalogDevice):
        drops, step = device.drops, 1e3 * device.step_v.median
        mean, variance, used = 1e3 * drops.mean_v, 1e6 * drops.variance_v2, drops.frames > 0
        is_dark, line = drops.light_hz == 0, f"{step:.3g} mV per event"
        axes.set(xlabel="mean drop of the output (mV)", ylabel="variance (mV²)")
    else:
        step, line = 1.0, "independent counts"
        mean, variance = (
            np.array([getattr(recording.of, name).ravel() for recording in device.recordings])
            for name in ("mean", "variance")
        )
        used, is_dark = mean > 0, np.array([not of.light_hz for of in device.recordings])
        axes.set(xlabel="mean of counts", ylabel="variance", xscale="log", yscale="log")
    dark = is_dark[:, None] & used
    for chosen, color, label in ((dark, style.GRAY, "dark"), (used & ~dark, style.BLUE, "light")):
        axes.plot(mean[chosen], variance[chosen], color=color, label=label, **look)
    ends = np.array([mean[used].min(initial=1.0), mean[used].max(initial=1.0)])
    axes.plot(ends, step * ends, color=style.VERMILION, linewidth=1.5, label=line)
    description = "Photon transfer: variance of readings over their mean"
    return style.with_legend(figure, "transfer", description, markerscale=3)


@style.in_style
def _saturation_chart(device: CountingDevice, efficiency: float, recovery: Recovery) -> Markup:
    """Draw counts over light at the median pixel, with both models and the line without loss."""
    figure, axes = style.new_axes(*style.CHART_PT)
    lit = [recording for recording in device.recordings if recording.light_hz]
    light, exposure_s = np.array([(of.light_hz, of.exposure_s) for of in lit]).T
    counts = [np.nanmedian(np.where(of.is_known, of.of.mean, np.nan)) for of in lit]
    axes.plot(light, counts / exposure_s, "o", color=style.BLACK, label="measured")
    grid = np.geomspace(light.min(), 1.5 * light.max(), 100)
    dark = device.dark_counts_hz
    rate = (dark.median if dark else 0.0) + efficiency * grid
    axes.plot(grid, rate, ":", color=style.BLACK, linewidth=1, label="without dead time")
    longest_s = float(exposure_s.max())
    for place, kind in enumerate(KINDS):
        recovers = recovery if kind == recovery.kind else Recovery(kind, *recovery[1:4])
        with suppress(UserError):  # its curve takes too long to compute
            counted = recovers.moments(rate, longest_s)[0]
            axes.plot(grid, counted / longest_s, **style.line_style(place), label=kind)
    axes.set(xscale="log", yscale="log", xlabel="light (photons/s per pixel)", ylabel="counts/s")
    axes.xaxis.set_minor_formatter(NullFormatter())
    return style.with_legend(figure, "saturation", "Saturation curve: counts over light")


def emva_section(
    device: Path,
    shape: tuple[int, ...],
    wavelength_nm: float | None,
    recorded: Sequence[tuple[float, standard.Step]],
) -> Section:
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
