"""Page of a calibration: estimates of the pixels, charts, maps, and the figures of EMVA 1288.

The figures are those of the calibrated device, from exact moments at 50 steps of light. If the
recordings have a dark and eight levels of light at one exposure, theirs are shown, too.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import NullFormatter

from megalopta.report import style
from megalopta.report.sections import Section, captioned, write_sections
from megalopta.report.style import BLACK, BLUE, VERMILION, line_style
from megalopta.report.text import number, with_error
from megalopta.sensor import Crosstalk, changed, load_sensor
from megalopta.sensor.calibrate import crosstalk as estimates, emva as standard, saturation
from megalopta.sensor.calibrate.counts import CountingDevice
from megalopta.sensor.calibrate.device import Device, Estimate
from megalopta.sensor.calibrate.emva import Emva, Step

UNKNOWN = "not known"
_PIXELS = (
    "Median over pixels, range of 90 % of them, and median half width of a pixel's 95 % CI. Rates "
    "include events that crosstalk and afterpulses add; the maps of the device file exclude them "
    "where they are found below."
)
CURVES = (
    "The step may change over the swing. If the saturation curve does not determine the kind of "
    "dead time, record brighter light. Short twilight looks like a shorter dead time. Its interval "
    "has what the delay of afterpulses leaves open."
)
_NEIGHBORS = (
    "Probability that an event fires a neighbor, from coincidences in the dark; afterpulses within "
    "the exposure, from the variance of dark counts, which read noise may hide. Detected effects "
    "(three standard errors) are in the device file, unless hot pixels tell them. Frames do not "
    "show the delay: five dead times are assumed."
)
_MAPS = (
    "Grain: scatter of pixels and of their estimates. Gradients: nonuniform light (efficiency) or "
    "temperature (dark counts). Rows and columns: readout. Gray: unknown."
)
BAD = (
    "Dead: no counts under light; stuck: one reading in all frames; saturated: at the counter's "
    "end in every recording; hot: significantly above ten times the median dark counts; telegraph: "
    "dark counts switch between two rates. The file bad.npy marks the first three, hot.npy and "
    "telegraph.npy the others; stuck.npy has the readings that do not change."
)
_NAMES = "right and left", "below and above", "diagonal", "other diagonal", "two aside", "two above"
_TITLE = "EMVA 1288"
_TEXT = (
    "Release 4, Linear; an event is one electron, a reading a count. The device's figures are "
    "computed from the calibration at 50 steps of light and an exposure of {}. Saturation is "
    "where the temporal variance is largest. With dead time the response is not linear, and R and "
    "K would be too small. They are corrected for the calibrated dead time (the device's by "
    "factors of {:.3g} and {:.3g}), and hold for dim light. The linearity error is not corrected."
)
_HEAD = "symbol", "quantity", "device", "recordings"
_ROWS: tuple[tuple[str, str, Callable[[Emva], float]], ...] = (
    ("η", "quantum efficiency (%)", lambda each: 100 * each.efficiency),
    ("R", "responsivity (counts per photon)", lambda each: each.responsivity),
    ("K", "system gain (counts per electron)", lambda each: each.gain),
    ("σ_d", "temporal dark noise (electrons)", lambda each: each.dark_noise),
    ("DSNU₁₂₈₈", "dark signal nonuniformity (electrons)", lambda each: each.dsnu),
    ("PRNU₁₂₈₈", "photoresponse nonuniformity (%)", lambda each: 100 * each.prnu),
    ("LE", "linearity error (%)", lambda each: 100 * each.linearity_error),
    ("µ_p.min", "absolute sensitivity threshold (photons)", lambda each: each.threshold_photons),
    ("µ_p.sat", "saturation (photons)", lambda each: each.saturation_photons),
    ("µ_e.sat", "saturation capacity (electrons)", lambda each: each.saturation_electrons),
    ("SNR_max", "largest signal-to-noise ratio (dB)", lambda each: each.snr_db),
    ("DR", "dynamic range (dB)", lambda each: each.dynamic_range_db),
)


@dataclass(frozen=True, eq=False)
class Quantity:
    """One estimate of every pixel, as the page tells it."""

    name: str
    unit: str
    estimate: Estimate
    scale: float
    """Factor to that unit"""

    @property
    def median(self) -> float:
        """Median over the pixels, in its unit."""
        return self.scale * self.estimate.median

    @property
    def row(self) -> tuple[str, ...]:
        """Median, range and half width, as a row of the table."""
        title, estimate = f"{self.name} ({self.unit})", self.estimate
        if not np.isfinite(estimate.value).any():
            return (title, UNKNOWN, "", "", "")
        low, median, high = self.scale * np.nanpercentile(estimate.value, (5, 50, 95))
        widths = self.scale * (estimate.high - estimate.low) / 2
        half = float(np.nanmedian(widths)) if np.isfinite(widths).any() else np.nan
        return (title, *(number(float(value)) for value in (median, low, high, half)))


def write_page(
    path: Path,
    summary: str,
    quantities: Sequence[Quantity],
    sections: Sequence[Section | None],
) -> None:
    """Write a page: the table of quantities, sections, and their maps before the last one."""
    charts = (
        style.map_chart(each.scale * each.estimate.value, f"map-{at}", f"{each.name} ({each.unit})")
        for at, each in enumerate(quantities)
        if np.isfinite(each.estimate.value).any()
    )
    head = ("", "median", "from", "to", "± (95 % CI)")
    rows = tuple(quantity.row for quantity in quantities)
    table = Section("The pixels", _PIXELS, head, rows)
    maps = Section("Maps", _MAPS, charts=tuple(charts))
    shown = [table, *sections[:-1], maps, sections[-1]]
    write_sections(path, f"Calibration of {path.stem}", summary, shown)


def neighbors_section(
    kernel: estimates.Kernel | None, of_hot_pixels: float = 0.0
) -> Section | None:
    """Tell crosstalk by coincidences, and by hot pixels (%), and afterpulses."""
    hot = ("all around, of hot pixels", f"{of_hot_pixels:.2f} %", "yes" if of_hot_pixels else "no")
    head = ("neighbor", "probability (95 % CI)", "detected")
    if kernel is None:
        return Section("Crosstalk", _NEIGHBORS, head, (hot,)) if of_hot_pixels else None
    names = [f"{name} {at}" for name, at in zip(_NAMES, estimates.OFFSETS, strict=True)]
    seen = [kernel.is_seen] * (len(names) + 1)
    rows = zip(
        [*names, "all neighbors", "afterpulses"],
        [*kernel.share, 2 * kernel.share.sum(), kernel.afterpulses],
        [*kernel.error, kernel.total_error, kernel.afterpulses_error],
        [*seen, kernel.are_afterpulses_seen],
        strict=True,
    )
    texts = tuple(
        (
            name,
            UNKNOWN if np.isnan(share) else with_error(100 * share, 196 * error, "%"),
            "yes" if is_seen else "no",
        )
        for name, share, error, is_seen in rows
    )
    return Section("Crosstalk and afterpulses", _NEIGHBORS, head, (*texts, hot))


def medians(quantities: Sequence[Quantity]) -> str:
    """Tell the medians in a line."""
    return ", ".join(f"{each.name} {number(each.median)} {each.unit}" for each in quantities)


def reasons(device: CountingDevice) -> str:
    """Tell what the recordings do not show, and why."""
    return "; ".join(f"{name}: {reason}" for name, reason in device.refused.items())


def counting_parts(
    device: CountingDevice, quantities: Sequence[Quantity], talk: Crosstalk | None
) -> tuple[str, list[Section | None]]:
    """Return the summary and the sections of a camera of counts or bits."""
    dead, hidden = device.dead_time, None
    dead_time, told = "", medians(quantities)
    if dead is not None:
        kind = dead.kind if dead.is_kind_clear else f"kind undetermined, taken as {dead.kind}"
        dead_time = with_error(dead.seconds, 1.96 * dead.error, "s")
        told += f", dead time {dead_time} ({kind})"
        rows = ("dead time (95 % CI)", dead_time), ("its kind", kind)
        hidden = Section("Dead time", CURVES, ("", "estimate"), rows)
    switching = int(device.telegraph.pixels.sum()) if device.telegraph else 0
    noisy = f", {switching} with telegraph noise" if switching else ""
    unknown = f" Not known: {reasons(device)}." if device.refused else ""
    summary = (
        f"{device.bad.size} pixels, {int(device.bad.sum())} bad, {int(device.hot.sum())} hot"
        f"{noisy}; medians: {told}.{unknown}"
    )
    kinds = ("dead", "stuck", "saturated", "hot")
    bad = [(kind, str(int(getattr(device, kind).sum()))) for kind in kinds]
    return summary, [
        hidden,
        Section("Not known", f"{reasons(device)}.") if device.refused else None,
        Section("Bad and hot pixels", BAD, ("", "pixels"), (*bad, ("telegraph", str(switching)))),
        neighbors_section(device.kernel, 100 * talk.mean_fired_neighbors if talk else 0.0),
    ]


def curves_section(device: Device) -> Section:
    """Return photon transfer, and under light the saturation curve, with what they determine."""
    kind, is_known = device.dead_time_kind, bool(np.isfinite(device.slope_error))
    slope, error = 100 * device.curve.slope, 196 * device.slope_error
    seen = "changes" if device.is_slope_seen else "no change seen"
    likely = f"likelihood ratio e^{device.kind_ratio:.0f}" if kind else ""
    if device.misfit:
        likely = f"counts differ from the curves of both by {100 * device.misfit:+.2g} %"
    rows = (
        (
            "decrease of the step from top to bottom of the swing",
            f"{with_error(slope, error, '%')} (95 %)" if is_known else UNKNOWN,
            seen if is_known else "",
        ),
        ("kind of dead time", kind or UNKNOWN, likely),
    )
    charts = [
        captioned(
            _drops_chart(device),
            "A point per pixel and level. On the line, noise is that of single events; points of "
            "bright light lie below it where dead time regularizes events.",
        )
    ]
    if device.efficiency is not None and device.dead_time_s is not None:
        charts.append(
            captioned(
                _saturation_chart(device, device.efficiency, device.dead_time_s),
                "Counts of the median pixel. Their distance below the line without dead time gives "
                "the dead time; its kind shows where the two models diverge.",
            )
        )
    head = ("", "estimate", "confidence")
    return Section("Photon transfer and saturation", CURVES, head, rows, tuple(charts))


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
    shape: tuple[int, int],
    wavelength_nm: float | None,
    recorded: Sequence[tuple[float, Step]],
) -> Section:
    """Return the section of a device file of (rows, columns) pixels, or why there is none.

    `recorded` are exposure (s) and readings of each recording.
    """
    exposures = [exposure_s for exposure_s, step in recorded if step.photons]
    if wavelength_nm is None or not exposures:
        return Section(_TITLE, "Needs recordings of light and --wavelength-nm.")
    exposure_s = max(set(exposures), key=exposures.count)
    sensor = changed(load_sensor(device), exposure_s=exposure_s)
    if sensor.counter.capacity == 1:
        return Section(_TITLE, "Needs counts: sum binary frames, 255 or more each.")
    try:
        dark, steps = standard.device_steps(sensor, shape, wavelength_nm)
        factors = standard.without_dead_time(sensor, shape, wavelength_nm, steps)
        figures = [standard.emva(dark, steps, factors=factors)]
    except ValueError as problem:
        return Section(_TITLE, f"Not known: {problem}.")
    seen = [step for each, step in recorded if each == exposure_s]
    darkest, lit = min(seen, key=lambda step: step.photons), [s for s in seen if s.photons]
    if not darkest.photons and len(lit) >= standard.FEWEST_STEPS:
        seen_factors = standard.without_dead_time(sensor, shape, wavelength_nm, lit)
        figures.append(standard.emva(darkest, lit, factors=seen_factors))
    rows = tuple(
        (symbol, title, *(number(of(each)) for each in figures), *("",) * (2 - len(figures)))
        for symbol, title, of in _ROWS
    )
    return Section(_TITLE, _TEXT.format(with_error(exposure_s, 0, "s"), *factors), _HEAD, rows)
