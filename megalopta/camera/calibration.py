"""`megalopta spadcam calibrate`: from codes of SPADCAM to a device file, its maps and its page.

`sensors: [DEVICE.yaml]` loads the device file.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import NullFormatter

from megalopta.camera.device_files import filled, save_map, write_device_file, write_maps
from megalopta.camera.emva_page import emva_section
from megalopta.camera.recording import Beam, Source, read_recorded
from megalopta.core.arrays import Floats
from megalopta.report.sections import Section, captioned, write_sections
from megalopta.report.style import (
    BLACK,
    BLUE,
    CHART_PT,
    VERMILION,
    in_style,
    line_style,
    map_chart,
    new_axes,
    to_svg,
    with_legend,
)
from megalopta.report.text import number, with_error
from megalopta.sensor import AnalogCounter, Sensor, preset
from megalopta.sensor.calibrate.device import Device, Estimate, calibrate_device
from megalopta.sensor.calibrate.emva import Step
from megalopta.sensor.calibrate.level import Adc, Level
from megalopta.sensor.calibrate.neighbors import OFFSETS, Kernel
from megalopta.sensor.calibrate.saturation import DeadTimeKind, dead_time_moments
from megalopta.sensor.effects import crosstalk
from megalopta.sensor.effects.crosstalk import Crosstalk

Quantity = tuple[str, str, Estimate, float]
"""Name, unit, estimate of every pixel, and factor to that unit"""

_95 = 1.959964
_SLOWEST_DEAD_TIMES = 5.0
"""Assumed delay of afterpulses in dead times; frames do not show it, a shorter one hides them."""


def write_device(
    path: Path, device: Device, base: Sensor, wavelength_nm: float | None, preset: str
) -> None:
    """Write a device file, and its maps with intervals to a folder next to it.

    Parameters
    ----------
    path : Path
        YAML file; maps are in a folder of its name without the suffix.
    device : Device
    base : Sensor
        Supplies everything that is not measured.
    wavelength_nm : float, optional
        Wavelength of flat frames; None: unknown, so efficiency is relative.
    preset : str
        Name of the base sensor.
    """
    folder, fall = path.with_suffix(""), device.offset_v
    maps = {
        "dark_counts": primary(device.dark_counts_hz, device.kernel),
        "step": device.step_v,
        "leak": device.leak_v_s,
        "offset": Estimate(-fall.value, -fall.high, -fall.low),  # a voltage drop as a rise
    }
    if device.efficiency is not None:
        nominal = nominal_efficiency(device.efficiency, base, wavelength_nm)
        maps["efficiency"] = primary(device.efficiency, device.kernel).scaled(1 / nominal)
    named = write_maps(folder, maps)
    save_map(folder / "hot.npy", device.hot)
    write_device_file(path, _fields(path, device, base, preset, named))


def nominal_efficiency(found: Estimate, base: Sensor, wavelength_nm: float | None) -> float:
    """Efficiency that a map is relative to: the base sensor's, or the mean at an unknown color."""
    if wavelength_nm is None:
        return float(np.nanmean(found.value))
    return float(base.photon_detection_efficiency(np.array(wavelength_nm)))


def _fields(
    path: Path, device: Device, base: Sensor, preset: str, maps: dict[str, str]
) -> dict[str, Any]:
    counter: dict[str, Any] = {"step_v": _median(device.step_v), "step_sigma_v": 0.0}
    if "leak" in maps:
        counter |= {"leak_v_s": max(_median(device.leak_v_s), 0.0), "leak_sigma_v_s": 0.0}
    counter["read_noise_v"] = _median(device.read_noise_v)
    if device.is_slope_seen:
        counter["step_slope"] = device.curve.slope
    fields: dict[str, Any] = {
        "preset": preset,
        "name": path.stem,
        "source": f"calibrated by {device.method} from {len(device.levels)} recordings",
        "counter": counter,
    }
    if device.dead_time_s is not None and device.dead_time_kind is not None:
        seconds = float(np.nanmedian(device.dead_time_s.value))
        fields["dead_time"] = {"kind": device.dead_time_kind, "dead_time_s": seconds}
    fields |= coincident_fields(device.kernel, fields, base)
    fields["measured"] = {**maps, "fit": "exact"}
    return fields


def coincident_fields(
    kernel: Kernel | None, known: Mapping[str, Any], base: Sensor
) -> dict[str, Any]:
    """Fields of the crosstalk and of the trapped carriers that reproduce what was observed.

    The dead time is that of the known fields, or the base sensor's.
    """
    fields: dict[str, Any] = {}
    if (light := _crosstalk_of(kernel)) is not None:
        fields["crosstalk"] = light.model_dump(exclude_defaults=True)
    if kernel is not None and kernel.are_afterpulses_seen:
        dead_time_s = known.get("dead_time", {}).get("dead_time_s", base.dead_time.dead_time_s)
        delay_s = max(base.afterpulsing.delay_s, _SLOWEST_DEAD_TIMES * dead_time_s)
        carriers = kernel.afterpulses * float(np.exp(dead_time_s / delay_s))
        fields["afterpulsing"] = {"mean_carriers": min(carriers, 0.95), "delay_s": delay_s}
    return fields


def _crosstalk_of(kernel: Kernel | None) -> Crosstalk | None:
    """Crosstalk for the sensor stage, if there is any."""
    if kernel is None or not kernel.is_seen:
        return None
    shares = np.maximum(kernel.share, 0.0)
    orthogonal, diagonal, two = (float(shares[at : at + 2].mean()) for at in (0, 2, 4))
    return Crosstalk(
        mean_fired_neighbors=min(float(2 * shares.sum()), 0.8),  # each offset in both directions
        diagonal=min(diagonal / orthogonal, 1.0),
        distance_two=min(two / orthogonal, 1.0),
    )


def primary(estimate: Estimate, kernel: Kernel | None) -> Estimate:
    """Return rates without events of neighbors and traps, which the simulation adds again.

    Its interval includes the error of what is subtracted, which all pixels share.
    """
    fired, error = np.zeros_like(estimate.value), np.zeros_like(estimate.value)
    if kernel is not None and kernel.are_afterpulses_seen:
        fired += kernel.afterpulses * estimate.value
        error = np.hypot(error, kernel.afterpulses_error * estimate.value)
    if (light := _crosstalk_of(kernel)) is not None and kernel is not None:
        by_light = crosstalk.fired_mean(filled(estimate.value), light)
        fired += by_light
        error = np.hypot(error, by_light * kernel.total_error / light.mean_fired_neighbors)
    value = estimate.value - fired
    below = np.hypot(estimate.value - estimate.low, _95 * error)
    above = np.hypot(estimate.high - estimate.value, _95 * error)
    return Estimate(value, value - below, value + above)


_FITTED = 2
"""Fitted parameters, efficiency and dead time; dark counts come from dark frames."""
_UNKNOWN = "not known"
_PIXELS = (
    "Median over pixels, range of 90 % of them, and median half width of a pixel's 95 % CI. If "
    "read noise hides single events, leakage counts as dark counts."
)
_CURVES = (
    "The step may change over the swing. If the saturation curve does not determine the kind of "
    "dead time, record brighter light."
)
_NEIGHBORS = (
    "Probability that an event fires a neighbor, from coincidences in the dark; afterpulses within "
    "the exposure, from the variance of dark counts, which read noise may hide. Detected effects "
    "are in the device file. Frames do not show the delay: five dead times are assumed."
)
_MAPS = (
    "Grain: scatter of pixels and of their estimates. Gradients: nonuniform light (efficiency) or "
    "temperature (dark counts). Rows and columns: readout. Gray: unknown."
)
_NAMES = "right and left", "below and above", "diagonal", "other diagonal", "two aside", "two above"


def write_calibration_report(
    path: Path, device: Device, name: str, is_relative: bool, standard: Section
) -> None:
    """Write the calibration of a device, with pictures; relative: light of unknown wavelength.

    `standard` is the section on EMVA 1288.
    """
    table, maps = pixel_sections(_quantities(device, is_relative), _PIXELS, _MAPS)
    sections = [
        table,
        Section(
            "Photon transfer and saturation",
            _CURVES,
            ("", "estimate", "confidence"),
            _laws(device),
            tuple(_curves(device)),
        ),
        *_neighbors(device),
        maps,
        standard,
    ]
    write_sections(path, f"Calibration of {name}", calibration_summary(device), sections)


def calibration_summary(device: Device) -> str:
    """Return the estimates, medians over the pixels, on one line."""
    known = int(np.isfinite(device.step_v.value).sum())
    medians = (
        f"{title} {number(scale * _median(estimate))} {unit}"
        for title, unit, estimate, scale in _quantities(device, is_relative=True)
    )
    return (
        f"{known} of {device.hot.size} pixels, {int(device.hot.sum())} hot; medians: "
        f"{', '.join(medians)}; dead time: {device.dead_time_kind or f'kind {_UNKNOWN}'}."
    )


def _median(estimate: Estimate) -> float:
    return float(np.nanmedian(estimate.value)) if np.isfinite(estimate.value).any() else np.nan


def _quantities(device: Device, is_relative: bool) -> list[Quantity]:
    """Return all estimates per pixel."""
    found = [
        ("dark counts", "Hz", device.dark_counts_hz, 1.0),
        ("step", "mV", device.step_v, 1e3),
        ("offset", "mV", device.offset_v, 1e3),
        ("leak", "mV/s", device.leak_v_s, 1e3),
        ("read noise", "mV", device.read_noise_v, 1e3),
    ]
    if device.efficiency is not None and device.dead_time_s is not None:
        scale, unit = (
            (1 / _median(device.efficiency), "of the median") if is_relative else (100, "%")
        )
        found.append(("efficiency", unit, device.efficiency, scale))
        found.append(("dead time", "µs", device.dead_time_s, 1e6))
    return found


def pixel_sections(
    found: Sequence[Quantity], about: str, about_maps: str
) -> tuple[Section, Section]:
    """Return the section with a table of estimates, and that with their maps."""
    charts = (
        map_chart(scale * estimate.value, f"map-{at}", f"{title} ({unit})")
        for at, (title, unit, estimate, scale) in enumerate(found)
        if np.isfinite(estimate.value).any()
    )
    head, rows = ("", "median", "from", "to", "± (95 % CI)"), (_row(*each) for each in found)
    table = Section("The pixels", about, head, tuple(rows))
    return table, Section("Maps", about_maps, charts=tuple(charts))


def _row(title: str, unit: str, estimate: Estimate, scale: float) -> tuple[str, ...]:
    """Return median, range and half width of an estimate, in a unit of so many of its own."""
    if not np.isfinite(estimate.value).any():
        return (f"{title} ({unit})", _UNKNOWN, "", "", "")
    low, median, high = scale * np.nanpercentile(estimate.value, (5, 50, 95))
    widths = scale * (estimate.high - estimate.low) / 2
    half = float(np.nanmedian(widths)) if np.isfinite(widths).any() else np.nan
    return (f"{title} ({unit})", *(number(float(each)) for each in (median, low, high, half)))


def _laws(device: Device) -> tuple[tuple[str, str, str], ...]:
    """Return rows on the step over the swing, and on the kind of dead time."""
    slope, error = 100 * device.curve.slope, 196 * device.slope_error
    is_known = bool(np.isfinite(device.slope_error))
    seen = "changes" if device.is_slope_seen else "no change seen"
    likely = f"likelihood ratio e^{device.kind_ratio:.0f}"
    kind = device.dead_time_kind
    return (
        ("steps estimated by", device.method, ""),
        (
            "decrease of the step from top to bottom of the swing",
            f"{with_error(slope, error, '%')} (95 %)" if is_known else _UNKNOWN,
            seen if is_known else "",
        ),
        ("kind of dead time", kind or _UNKNOWN, likely if kind else _misfit(device)),
    )


def _misfit(device: Device) -> str:
    off = f"counts differ from the curves of both by {100 * device.misfit:+.2g} %"
    return off if device.misfit else ""


def _curves(device: Device) -> Iterator[Markup]:
    yield captioned(
        falls_chart(device),
        "A point per pixel and level. On the line, noise is that of single events; points of "
        "bright light lie below it where dead time regularizes events.",
    )
    if device.efficiency is None:
        return
    yield captioned(
        saturation_chart(device),
        "Counts of the median pixel. Their distance below the line without dead time gives the "
        "dead time; its kind shows where the two models diverge.",
    )
    z = saturation_residuals(device)
    expected = np.sqrt(max(1 - _FITTED / len(z), 0.0))
    yield captioned(
        residual_chart(device),
        f"RMS residual of the saturation curve: {np.sqrt(np.nanmean(z**2)):.2f} standard errors, "
        f"about {expected:.2f} if the model holds ({len(z)} light levels, {_FITTED} parameters per "
        "pixel); more means nonuniform or unsteady light.",
    )


def _neighbors(device: Device) -> Iterator[Section]:
    kernel = device.kernel
    if kernel is None:
        return
    shares = [*kernel.share, kernel.afterpulses]
    errors = [*kernel.error, kernel.afterpulses_error]
    seen = [*[kernel.is_seen] * len(_NAMES), kernel.are_afterpulses_seen]
    names = [f"{name} {offset}" for name, offset in zip(_NAMES, OFFSETS, strict=True)]
    rows = [
        (
            name,
            _UNKNOWN if np.isnan(share) else with_error(100 * share, 196 * error, "%"),
            "yes" if is_seen else "no",
        )
        for name, share, error, is_seen in zip(
            [*names, "afterpulses"], shares, errors, seen, strict=True
        )
    ]
    head = ("neighbor", "probability (95 % CI)", "detected")
    yield Section("Crosstalk and afterpulses", _NEIGHBORS, head, tuple(rows))


def calibrate_codes(sources: Sequence[Source], out: Path, beam: Beam, base: str) -> str:
    """Write the device file of a SPADCAM, its maps and its report; return a summary.

    Raises ValueError or UserError as `calibrating.calibrate_recordings`.
    """
    sensor = preset(base)
    levels = []
    for source in sources:
        recording, light = read_recorded(source), beam.photons_hz(source.light, sensor)
        assert recording.codes is not None
        exposure_s = source.exposure_s or recording.exposure_s
        levels.append(Level(recording.codes, exposure_s, light))
    device = calibrate_device(levels, adc_of(sensor))
    write_device(out, device, sensor, beam.wavelength_nm, base)
    is_relative = beam.wavelength_nm is None
    recorded = [
        (each.exposure_s, Step.of(each.light_hz * each.exposure_s, each.signal)) for each in levels
    ]
    shape = levels[0].readings.shape[1:]
    standard = emva_section(out, (shape[0], shape[1]), beam.wavelength_nm, recorded)
    write_calibration_report(out.with_suffix(".html"), device, out.stem, is_relative, standard)
    return calibration_summary(device)


def adc_of(sensor: Sensor) -> Adc:
    """Return the ADC of a sensor's counters. Raises ValueError if it has none."""
    counter = sensor.counter
    if not isinstance(counter, AnalogCounter) or counter.adc_bits is None:
        raise ValueError(f"{sensor.name}: no analog counter with an ADC; choose spadcam")
    top = counter.supply_v / counter.lsb_v
    return Adc(counter.lsb_v, top, top - counter.swing_v / counter.lsb_v)


_KINDS: tuple[DeadTimeKind, ...] = ("paralyzable", "nonparalyzable")


@in_style
def falls_chart(device: Device) -> Markup:
    """Draw variance over mean voltage drop, all pixels at all levels, with the line of the step."""
    figure, axes = new_axes(*CHART_PT)
    used = device.falls.frames > 0
    dark = (device.counts.light_hz == 0)[:, None] & used
    mean, variance = 1e3 * device.falls.mean_v, 1e6 * device.falls.variance_v2
    for chosen, color, label in ((dark, BLACK, "dark"), (used & ~dark, BLUE, "light")):
        axes.plot(mean[chosen], variance[chosen], ".", color=color, markersize=2, label=label)
    ends = np.array([0.0, float(mean[used].max(initial=1.0))])
    step = 1e3 * float(np.nanmedian(device.step_v.value))
    axes.plot(ends, step * ends, color=VERMILION, linewidth=1.5, label=f"{step:.3g} mV per event")
    axes.set(xlabel="mean drop of the output (mV)", ylabel="variance (mV²)")
    description = "Photon transfer: variance of readings over their mean"
    return with_legend(figure, "transfer", description, markerscale=3)


@in_style
def saturation_chart(device: Device) -> Markup:
    """Draw counts over light at the median pixel, with both models and the line without loss."""
    figure, axes = new_axes(*CHART_PT)
    assert device.efficiency is not None and device.dead_time_s is not None
    lit = device.counts.light_hz > 0
    light, exposure = device.counts.light_hz[lit], device.counts.exposure_s[lit]
    mean = np.where(device.falls.frames[lit] > 0, device.counts.mean[lit], np.nan)
    axes.plot(light, np.nanmedian(mean, axis=1) / exposure, "o", color=BLACK, label="measured")
    eta, tau = (np.nanmedian(each.value) for each in (device.efficiency, device.dead_time_s))
    grid = np.geomspace(light.min(), 1.5 * light.max(), 100)
    rate = np.nanmedian(device.dark_counts_hz.value) + eta * grid
    axes.plot(grid, rate, ":", color=BLACK, linewidth=1, label="without dead time")
    for place, kind in enumerate(_KINDS):
        law = dead_time_moments(rate, exposure.max(), np.full(rate.shape, tau), kind)[0]
        axes.plot(grid, law / exposure.max(), **line_style(place), label=kind)
    axes.set(xscale="log", yscale="log", xlabel="light (photons/s per pixel)", ylabel="counts/s")
    axes.xaxis.set_minor_formatter(NullFormatter())
    return with_legend(figure, "saturation", "Saturation curve: counts over light")


@in_style
def residual_chart(device: Device) -> Markup:
    """Draw standardized residuals of mean counts at the light levels."""
    figure, axes = new_axes(*CHART_PT)
    axes.hist(
        saturation_residuals(device).ravel(), bins=60, range=(-6, 6), density=True, color=BLUE
    )
    z = np.linspace(-6, 6, 200)
    axes.plot(z, np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi), color=BLACK, linewidth=1.5)
    axes.set(xlabel="residual (standard errors)", ylabel="density")
    return to_svg(figure, "residuals", "Residuals of the saturation curve, with a normal law")


def saturation_residuals(device: Device) -> Floats:
    """Return mean counts minus the fit, in standard errors; NaN without a fit.

    If the curve does not determine the kind of dead time, the kind with smaller residuals is used.
    """
    kinds = [kind for kind in _KINDS if device.dead_time_kind in (None, kind)]
    left = [_residuals_of(device, kind) for kind in kinds]
    return min(left, key=lambda each: float(np.nansum(each**2)))


def _residuals_of(device: Device, kind: DeadTimeKind) -> Floats:
    assert device.efficiency is not None and device.dead_time_s is not None
    lit = (device.counts.light_hz > 0) & (device.counts.exposure_s > 0)
    eta, tau, dark = (
        each.value.ravel()
        for each in (device.efficiency, device.dead_time_s, device.dark_counts_hz)
    )
    rate = dark + eta * device.counts.light_hz[lit][:, None]
    mean, variance = dead_time_moments(rate, device.counts.exposure_s[lit][:, None], tau, kind)
    frames = np.where(device.counts.frames[lit] > 0, device.counts.frames[lit], np.nan)
    return np.asarray((device.counts.mean[lit] - mean) / np.sqrt(variance / frames))
