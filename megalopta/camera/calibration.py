"""`megalopta spadcam calibrate`: recordings, or tables, to a device file, its maps and its page.

Codes of SPADCAM give all its parameters (`sensor.calibrate.device`); counts and bits of other
cameras give dark counts, efficiency, dead time and bad pixels (`sensor.calibrate.counts`). A device
file is YAML, with maps as .npy files in a folder next to it; `sensors: [DEVICE.yaml]` loads it. Its
maps are without events that crosstalk and afterpulses add, which the simulation adds again.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.camera import calibration_page as pages
from megalopta.camera.measurements import Measurement
from megalopta.camera.recording import is_recording
from megalopta.camera.sources import Beam, Source, read_recorded
from megalopta.core import files, strict_yaml
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError, refused_as
from megalopta.report.sections import Section
from megalopta.report.text import number, with_error
from megalopta.sensor import Afterpulsing, AnalogCounter, Crosstalk, Sensor, preset
from megalopta.sensor.calibrate import crosstalk as estimates
from megalopta.sensor.calibrate.counts import CountingDevice, calibrate_counts, summed, summed_bits
from megalopta.sensor.calibrate.device import Device, Estimate, calibrate_device
from megalopta.sensor.calibrate.emva import Step
from megalopta.sensor.calibrate.level import Adc, Level
from megalopta.sensor.calibrate.time_tags import Autocorrelation, fit_table
from megalopta.sensor.effects import crosstalk

_95 = 1.959964
_SLOWEST_DEAD_TIMES = 5.0
"""Assumed delay of afterpulses in dead times; frames do not show it, a shorter one hides them."""
_UP_TO_S = 8e-6
"""Longest delay of an afterpulse in tables; later ones count as dark counts."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """Content of the file and the page of a device."""

    source: str
    """Method and data behind it"""
    fields: Mapping[str, Any]
    """Fields of the device file, without maps"""
    maps: Mapping[str, Estimate]
    """Maps with intervals, by their names in `measured`"""
    masks: Mapping[str, NDArray[Any]]
    """Further maps (rows, columns)"""
    summary: str
    quantities: Sequence[pages.Quantity] = ()
    sections: Sequence[Section | None] = field(default=())
    """Parts of the page, between the table of pixels and their maps"""


def calibrate_recordings(
    sources: Sequence[Source], out: Path, *, beam: Beam, base: str = "spadcam"
) -> str:
    """Write a device file, its maps and its page; return a summary in a sentence.

    Raises UserError if a recording cannot be read, or all of them do not suffice for a calibration.
    """
    if out.suffix not in (".yaml", ".yml"):
        raise UserError(f"--out {out}: give the name of a .yaml file")
    kinds = {is_recording(source.path) for source in sources}
    if len(kinds) > 1:
        raise UserError("calibrate: recordings of SPADCAM and of others; give those of one camera")
    if True in kinds and any(source.sums for source in sources):
        raise UserError("sums: of recordings of SPADCAM; omit it, or give a file of sums")
    with refused_as("calibrate"):
        sensor = preset(base)
        calibrate = _calibrate_codes if True in kinds else _calibrate_counts
        calibration, steps = calibrate(sources, beam, sensor)
    write_device(out, calibration, base)
    shape = next(iter(calibration.masks.values())).shape
    standard = pages.emva_section(out, (shape[0], shape[1]), beam.wavelength_nm, steps)
    pages.write_page(
        out.with_suffix(".html"),
        calibration.summary,
        calibration.quantities,
        [*calibration.sections, standard],
    )
    return calibration.summary


def write_device(path: Path, calibration: Calibration, base: str) -> None:
    """Write a device file, and its maps with intervals to a folder next to it.

    Pixels without an estimate get the median; their intervals are NaN. `base` names the preset,
    which supplies everything that is not measured.
    """
    folder, measured = path.with_suffix(""), {}
    arrays: dict[str, NDArray[Any]] = dict(calibration.masks)
    for name, estimate in calibration.maps.items():
        if np.isfinite(estimate.value).any():
            lowest = 0.0 if name in ("dark_counts", "efficiency") else -np.inf
            arrays[name] = np.maximum(_filled(estimate.value), lowest)
            arrays |= {f"{name}_low": estimate.low, f"{name}_high": estimate.high}
            measured[name] = f"{folder.name}/{name}.npy"
    for name in ("dark_counts", "telegraph", "stuck"):
        if name in calibration.masks:
            measured[name] = f"{folder.name}/{name}.npy"
    for name, values in arrays.items():
        with files.atomic_write(folder / f"{name}.npy") as temporary:
            np.save(temporary, values)
    fields: dict[str, Any] = {
        "preset": base,
        "name": path.stem,
        "source": calibration.source,
        "measured": {**measured, "fit": "exact"},
        **calibration.fields,
    }
    if "crosstalk" in arrays:
        fields["crosstalk"]["kernel"] = {"path": f"{folder.name}/crosstalk.npy"}
    text = strict_yaml.dump(fields)
    files.write_text(path, f"# Written by megalopta spadcam calibrate.\n{text}")


def _filled(values: Floats) -> Floats:
    """Return maps with missing values replaced by the median."""
    return np.where(np.isfinite(values), values, np.nanmedian(values))


def _efficiencies(
    efficiency: Estimate, sensor: Sensor, wavelength_nm: float | None
) -> tuple[float, pages.Quantity]:
    """Efficiency that a map is relative to, the mean at an unknown color; and as it is told."""
    if wavelength_nm is None:
        shown = pages.Quantity("efficiency", "of the median", efficiency, 1 / efficiency.median)
        return float(np.nanmean(efficiency.value)), shown
    nominal = float(sensor.photon_detection_efficiency(np.array(wavelength_nm)))
    return nominal, pages.Quantity("efficiency", "%", efficiency, 100.0)


def primary(estimate: Estimate, kernel: estimates.Kernel | None) -> Estimate:
    """Return rates without events of neighbors and traps, which the simulation adds again.

    Its interval includes the error of what is subtracted, which all pixels share.
    """
    fired, error = np.zeros_like(estimate.value), np.zeros_like(estimate.value)
    if kernel is not None and kernel.are_afterpulses_seen:
        fired += kernel.afterpulses * estimate.value
        error = np.hypot(error, kernel.afterpulses_error * estimate.value)
    if kernel is not None and kernel.is_seen:
        light = _crosstalk_of(kernel)
        by_light = crosstalk.fired_mean(_filled(estimate.value), light)
        fired += by_light
        error = np.hypot(error, by_light * kernel.total_error / light.mean_fired_neighbors)
    value = estimate.value - fired
    below = np.hypot(estimate.value - estimate.low, _95 * error)
    above = np.hypot(estimate.high - estimate.value, _95 * error)
    return Estimate(value, value - below, value + above)


def _crosstalk_of(kernel: estimates.Kernel) -> Crosstalk:
    """Crosstalk for the sensor stage."""
    shares = np.maximum(kernel.share, 0.0)
    orthogonal, diagonal, two = (float(shares[at : at + 2].mean()) for at in (0, 2, 4))
    return Crosstalk(
        mean_fired_neighbors=min(float(2 * shares.sum()), 0.8),  # each offset in both directions
        diagonal=min(diagonal / orthogonal, 1.0),
        distance_two=min(two / orthogonal, 1.0),
    )


def _coincident_fields(
    kernel: estimates.Kernel | None, dead_time_s: float | None, base: Sensor
) -> dict[str, Any]:
    """Fields of the crosstalk and of the trapped carriers that reproduce what was observed."""
    fields: dict[str, Any] = {}
    if kernel is not None and kernel.is_seen:
        fields["crosstalk"] = _crosstalk_of(kernel).model_dump(exclude_defaults=True)
    if kernel is not None and kernel.are_afterpulses_seen:
        dead_s = base.dead_time.dead_time_s if dead_time_s is None else dead_time_s
        delay_s = max(base.afterpulsing.delay_s, _SLOWEST_DEAD_TIMES * dead_s)
        carriers = kernel.afterpulses * float(np.exp(dead_s / delay_s))
        fields["afterpulsing"] = {"mean_carriers": min(carriers, 0.95), "delay_s": delay_s}
    return fields


Steps = list[tuple[float, Step]]
"""Exposure (s) and readings of each recording, for EMVA 1288"""


def adc_of(sensor: Sensor) -> Adc:
    """Return the ADC of a sensor's counters. Raises ValueError if it has none."""
    counter = sensor.counter
    if not isinstance(counter, AnalogCounter) or counter.adc_bits is None:
        raise ValueError(f"{sensor.name}: no analog counter with an ADC; choose spadcam")
    top = counter.supply_v / counter.lsb_v
    return Adc(counter.lsb_v, top, top - counter.swing_v / counter.lsb_v)


def _calibrate_codes(
    sources: Sequence[Source], beam: Beam, sensor: Sensor
) -> tuple[Calibration, Steps]:
    levels = []
    for source in sources:
        recording, light_hz = read_recorded(source), beam.photons_hz(source.light, sensor)
        assert recording.codes is not None
        levels.append(Level(recording.codes, source.exposure_s or recording.exposure_s, light_hz))
    device = calibrate_device(levels, adc_of(sensor))
    steps = [(each.exposure_s, Step.of(each.light_hz * each.exposure_s, each.signal))
             for each in levels]  # fmt: skip
    return calibration_of_codes(device, sensor, beam.wavelength_nm), steps


def calibration_of_codes(device: Device, base: Sensor, wavelength_nm: float | None) -> Calibration:
    """Return what the file and the page of a SPADCAM hold.

    Without wavelength, efficiency is relative.
    """
    fall = device.offset_v
    maps = {
        "dark_counts": primary(device.dark_counts_hz, device.kernel),
        "step": device.step_v,
        "leak": device.leak_v_s,
        "offset": Estimate(-fall.value, -fall.high, -fall.low),  # a voltage drop as a rise
    }
    quantities = [
        pages.Quantity("dark counts", "Hz", device.dark_counts_hz, 1.0),
        pages.Quantity("step", "mV", device.step_v, 1e3),
        pages.Quantity("offset", "mV", device.offset_v, 1e3),
        pages.Quantity("leak", "mV/s", device.leak_v_s, 1e3),
        pages.Quantity("read noise", "mV", device.read_noise_v, 1e3),
    ]
    if device.efficiency is not None and device.dead_time_s is not None:
        nominal, shown = _efficiencies(device.efficiency, base, wavelength_nm)
        maps["efficiency"] = primary(device.efficiency, device.kernel).scaled(1 / nominal)
        quantities += [shown, pages.Quantity("dead time", "µs", device.dead_time_s, 1e6)]
    counter: dict[str, Any] = {"step_v": device.step_v.median, "step_sigma_v": 0.0}
    if np.isfinite(device.leak_v_s.value).any():
        counter |= {"leak_v_s": max(device.leak_v_s.median, 0.0), "leak_sigma_v_s": 0.0}
    counter["read_noise_v"] = device.read_noise_v.median
    if device.is_slope_seen:
        counter["step_slope"] = device.curve.slope
    fields: dict[str, Any] = {"counter": counter}
    dead_s = None
    if device.dead_time_s is not None and device.dead_time_kind is not None:
        dead_s = device.dead_time_s.median
        fields["dead_time"] = {"kind": device.dead_time_kind, "dead_time_s": dead_s}
    fields |= _coincident_fields(device.kernel, dead_s, base)
    known, kind = int(np.isfinite(device.step_v.value).sum()), device.dead_time_kind
    medians = ", ".join(f"{each.name} {number(each.median)} {each.unit}" for each in quantities)
    summary = (
        f"{known} of {device.hot.size} pixels, {int(device.hot.sum())} hot; medians: {medians}; "
        f"dead time: {kind or f'kind {pages.UNKNOWN}'}."
    )
    slope, error = 100 * device.curve.slope, 196 * device.slope_error
    is_known = bool(np.isfinite(device.slope_error))
    seen = "changes" if device.is_slope_seen else "no change seen"
    likely = f"likelihood ratio e^{device.kind_ratio:.0f}" if kind else ""
    if device.misfit:
        likely = f"counts differ from the curves of both by {100 * device.misfit:+.2g} %"
    rows = (
        (
            "decrease of the step from top to bottom of the swing",
            f"{with_error(slope, error, '%')} (95 %)" if is_known else pages.UNKNOWN,
            seen if is_known else "",
        ),
        ("kind of dead time", kind or pages.UNKNOWN, likely),
    )
    head = ("", "estimate", "confidence")
    charts = tuple(pages.code_charts(device))
    curves = Section("Photon transfer and saturation", pages.CURVES, head, rows, charts)
    sections = curves, pages.neighbors_section(device.kernel)
    source = f"calibrated by comb from {len(device.drops.exposure_s)} recordings"
    return Calibration(source, fields, maps, {"hot": device.hot}, summary, quantities, sections)


def _calibrate_counts(
    sources: Sequence[Source], beam: Beam, sensor: Sensor
) -> tuple[Calibration, Steps]:
    levels = []
    for source in sources:
        recorded, light_hz = read_recorded(source), beam.photons_hz(source.light, sensor)
        given = recorded.exposure_s, light_hz
        if source.sums and recorded.is_binary:
            raise ValueError(
                f"{source.path}: sums: {source.sums}, but its frames are bits; omit sums"
            )
        with refused_as(str(source.path)):
            levels.append(
                summed_bits(recorded.counts, source.sums, *given)
                if source.sums
                else summed(recorded.counts, *given, is_binary=recorded.is_binary)
            )
    dead = sensor.dead_time
    device = calibrate_counts(
        levels, None if dead.kind == "ideal" else (dead.dead_time_s, dead.kind)
    )
    if device.dark_counts_hz is None and device.efficiency is None:
        raise ValueError(_reasons(device))
    steps = [
        (each.exposure_s, Step(each.light_hz * each.exposure_s, each.mean, each.variance,
                               each.frames))
        for each in levels
    ]  # fmt: skip
    return calibration_of_counts(device, sensor, beam.wavelength_nm), steps


def calibration_of_counts(
    device: CountingDevice, base: Sensor, wavelength_nm: float | None
) -> Calibration:
    """Return what the file and the page of a camera of counts or bits hold.

    Without wavelength, efficiency is relative.
    """
    talk, kernel, dead = _crosstalk_of_hot_pixels(device), device.kernel, device.dead_time

    def mapped(estimate: Estimate) -> Estimate:
        """Dead pixels count nothing, other bad ones are unknown."""
        if talk.is_on:
            fired = crosstalk.fired_mean(_filled(estimate.value), talk)
            estimate = Estimate(
                *(each - fired for each in (estimate.value, estimate.low, estimate.high))
            )
        else:
            estimate = primary(estimate, kernel)
        return estimate.where(~device.stuck & ~device.saturated).where(~device.dead, 0.0)

    maps, quantities = {}, []
    masks: dict[str, NDArray[Any]] = {"bad": device.bad, "hot": device.hot}
    fields: dict[str, Any] = {"counter": {"kind": "digital"}}
    if device.capacity is not None:
        fields["counter"]["capacity"] = device.capacity
    if dead is not None:
        fields["dead_time"] = {"kind": dead.kind, "dead_time_s": dead.seconds}
    if device.dark_counts_hz is not None:
        quantities.append(pages.Quantity("dark counts", "Hz", device.dark_counts_hz, 1.0))
        maps["dark_counts"] = mapped(device.dark_counts_hz)
    if device.efficiency is not None:
        nominal, shown = _efficiencies(device.efficiency, base, wavelength_nm)
        quantities.append(shown)
        maps["efficiency"] = mapped(device.efficiency).scaled(1 / nominal)
    switching, many = device.telegraph, 0
    if switching is not None:  # its traps add the rest of the dark counts
        at, dark, many = switching.pixels, maps["dark_counts"], int(switching.pixels.sum())
        value = np.where(at, switching.low_hz, dark.value)
        maps["dark_counts"] = Estimate(value, dark.where(~at).low, dark.where(~at).high)
        steps = np.zeros(at.shape)
        steps[at] = switching.high_hz[at] / switching.low_hz[at] - 1
        step = float(np.median(steps[at]))
        masks["telegraph"] = steps / step
        times = dict.fromkeys(("fastest_s", "slowest_s"), switching.time_s)
        fields["telegraph"] = {"share": float(at.mean()), "step": step, **times}
    if talk.is_on:
        masks["crosstalk"] = np.array(talk.kernel)
        fields["crosstalk"] = {"mean_fired_neighbors": talk.mean_fired_neighbors}
    else:
        fields |= _coincident_fields(kernel, dead.seconds if dead else None, base)
    if (device.reading >= 0).any():
        masks["stuck"] = device.reading
    medians = [f"{each.name} {number(each.median)} {each.unit}" for each in quantities]
    rows: tuple[tuple[str, str], ...] = ()
    if dead is not None:
        taken = dead.kind if dead.is_kind_clear else f"kind undetermined, taken as {dead.kind}"
        told = with_error(dead.seconds, 1.96 * dead.error, "s")
        medians.append(f"dead time {told} ({taken})")
        rows = ("dead time (95 % CI)", told), ("its kind", taken)
    noisy = f", {many} with telegraph noise" if many else ""
    missing = f" Not known: {_reasons(device)}." if device.refused else ""
    summary = (
        f"{device.bad.size} pixels, {int(device.bad.sum())} bad, {int(device.hot.sum())} hot"
        f"{noisy}; medians: {', '.join(medians)}.{missing}"
    )
    kinds = ("dead", "stuck", "saturated", "hot")
    bad = [(kind, str(int(getattr(device, kind).sum()))) for kind in kinds]
    sections = (
        Section("Dead time", pages.CURVES, ("", "estimate"), rows) if rows else None,
        Section("Not known", f"{_reasons(device)}.") if device.refused else None,
        Section("Bad and hot pixels", pages.BAD, ("", "pixels"), (*bad, ("telegraph", str(many)))),
        pages.neighbors_section(kernel, 100 * talk.mean_fired_neighbors),
    )
    source = "calibrated from recordings of counts or bits"
    return Calibration(source, fields, maps, masks, summary, quantities, sections)


def _reasons(device: CountingDevice) -> str:
    return "; ".join(f"{name}: {reason}" for name, reason in device.refused.items())


def _crosstalk_of_hot_pixels(device: CountingDevice) -> Crosstalk:
    """Crosstalk as the dark counts of hot pixels and their neighbors show it, or none.

    None for bits, which the sensor draws without crosstalk.
    """
    dark = device.dark_counts_hz
    if dark is None or device.capacity == 1 or dark.value.size < estimates.FEWEST_PIXELS:
        return Crosstalk()
    rates = np.where(device.bad, np.nan, dark.value)
    try:
        return estimates.kernel_of(estimates.crosstalk_of_hot_pixels(rates))
    except ValueError:  # too many bad pixels
        return Crosstalk()


def write_array_device(path: Path, tables: Sequence[Measurement], base: str, source: str) -> str:
    """Write the device file of an array from its tables; return a summary in a sentence.

    Raises ValueError if a table does not suffice, or two are of one kind.
    """
    kinds: tuple[Any, ...] = (np.ndarray, estimates.PairCrosstalk, Autocorrelation)
    by_kind: list[list[Any]] = [
        [table for table in tables if isinstance(table, kind)] for kind in kinds
    ]
    if max(len(some) for some in by_kind) > 1:
        raise ValueError("2 tables of one kind; give those of one array")
    maps, pairs, lags = by_kind
    if not maps:
        raise ValueError("no map of dark counts; give a table of them")
    rates = maps[0]
    talk = estimates.fit_crosstalk(pairs[0]) if pairs else Crosstalk()
    pulses = fit_table(lags[0].of(slice(None), _UP_TO_S)) if lags else Afterpulsing()
    counted = _filled(rates)
    dark = np.maximum(counted - crosstalk.fired_mean(counted, talk), 0)
    fields = {}
    for name, effect in (("crosstalk", talk), ("afterpulsing", pulses)):
        if effect.is_on:
            fields[name] = effect.model_dump(mode="json", exclude_defaults=True)
    summary = (
        f"{rates.size} pixels, {int(np.isnan(rates).sum())} unknown; dark counts "
        f"{number(float(np.nanmedian(rates)))} Hz (median), crosstalk "
        f"{number(100 * talk.mean_fired_neighbors)} %, afterpulses "
        f"{number(100 * pulses.mean_carriers)} %"
    )
    masks = {"dark_counts": dark * (1 - pulses.mean_carriers)}
    write_device(path, Calibration(source, fields, {}, masks, summary), base)
    return summary
