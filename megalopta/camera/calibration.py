"""`megalopta spadcam calibrate`: recordings, or tables, to a device file, its maps and its page."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import mode
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.camera import calibration_page as pages
from megalopta.camera.measurements import Measurement
from megalopta.camera.recording import is_recording
from megalopta.camera.sources import Beam, Source, read_recorded
from megalopta.core import files, strict_yaml
from megalopta.core.arrays import Floats
from megalopta.core.bounded import read_text
from megalopta.core.errors import UserError, refused_as
from megalopta.core.progress import say, step
from megalopta.core.quantities import number
from megalopta.core.validation import merged
from megalopta.report.sections import Section
from megalopta.sensor import Afterpulsing, AnalogCounter, Crosstalk, Sensor
from megalopta.sensor.calibrate import counts, crosstalk as estimates
from megalopta.sensor.calibrate.device import AnalogDevice, calibrate_device
from megalopta.sensor.calibrate.emva import Step
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.calibrate.pixels import Estimate, Quantity
from megalopta.sensor.calibrate.time_tags import Autocorrelation, fit_table
from megalopta.sensor.effects import crosstalk
from megalopta.sensor.image_sensors import is_device_file, spad_named

_95 = 1.959964


@dataclass(frozen=True, eq=False)
class Calibration:
    """Content of the file and the page of a device."""

    source: str
    """Method and data behind it"""
    fields: dict[str, Any]
    """Fields of the device file, without maps"""
    maps: dict[str, Estimate] = field(default_factory=dict)
    """Maps with intervals, by their names in `measured`"""
    masks: dict[str, NDArray[Any]] = field(default_factory=dict)
    """Further maps (rows, columns)"""
    quantities: Sequence[Quantity] = ()
    summary: str = ""
    sections: Sequence[Section | None] = ()
    """Parts of the page, between the table of pixels and their maps"""


def calibrate_recordings(
    sources: Sequence[Source], out: Path, *, beam: Beam, base: str | None = None
) -> str:
    """Write a device file, its maps and its page; return a summary in a sentence.

    `base` is a preset, or a .yaml file with what is known of the camera; None: spadcam for its
    recordings, else ideal. Raises UserError if a recording cannot be read, or all of them do not
    suffice for a calibration.
    """
    if out.suffix not in (".yaml", ".yml"):
        raise UserError(f"--out {out}: give the name of a .yaml file")
    kinds = {is_recording(source.path) for source in sources}
    if len(kinds) > 1:
        raise UserError("calibrate: recordings of SPADCAM and of others; give those of one camera")
    maps = out.with_suffix("").absolute()
    if any(maps in (path := source.path.absolute(), *path.parents) for source in sources):
        raise UserError(f"--out {out}: its maps would lie among recordings; choose another name")
    base = base or ("spadcam" if True in kinds else "ideal")
    calibration_of = _of_recorded_codes if True in kinds else _of_recorded_counts
    with refused_as("calibrate"), step(f"estimating pixels from {len(sources)} recordings"):
        calibration, shape, steps = calibration_of(sources, beam, spad_named(base))
    write_device(out, calibration, base)
    with step("figures of EMVA 1288"):
        standard = pages.emva_section(out, shape, beam.wavelength_nm, steps)
    if base == "ideal":
        say(f"{out}: pitch and lens are of {base}, the exposure of lit recordings; state yours in "
            "a .yaml file for --preset, another exposure as in `sense … --sensors "
            f"\"[{{preset: {out}, exposure_s: 0.01}}]\"`")  # fmt: skip
    sections, page = [*calibration.sections, standard], out.with_suffix(".html")
    pages.write_page(page, calibration.summary, calibration.quantities, sections)
    return calibration.summary


def write_device(path: Path, calibration: Calibration, base: str) -> None:
    """Write a device file, and its maps with intervals to a folder next to it.

    Pixels without an estimate get the median; their intervals are NaN. `base` is a preset, or a
    file whose fields are copied, which supplies everything that is not measured.
    """
    stated: dict[str, Any] = {"preset": base}
    if is_device_file(base):
        known = spad_named(base).model_dump(mode="json")
        known["measured"] = {name: file for name, file in known["measured"].items() if file}
        named = strict_yaml.load(read_text(Path(base)))
        stated = {name: known.get(name, value) for name, value in named.items()}
    folder, measured = path.with_suffix(""), dict[str, Any]()
    arrays: dict[str, NDArray[Any]] = dict(calibration.masks)
    for name, estimate in calibration.maps.items():
        if np.isfinite(estimate.value).any():
            lowest = 0.0 if name in ("dark_counts", "efficiency") else -np.inf
            arrays[name] = np.maximum(_filled(estimate.value), lowest)
            arrays |= {f"{name}_low": estimate.low, f"{name}_high": estimate.high}
            measured[name] = f"{folder.name}/{name}.npy"
    if (share := calibration.fields.get("fill_factor")) and "efficiency" in measured:
        measured["efficiency"] = {"path": measured["efficiency"], "fill_factor": share}
    for name in ("dark_counts", "telegraph", "stuck"):
        if name in calibration.masks:
            measured[name] = f"{folder.name}/{name}.npy"
    for name, values in arrays.items():
        with files.atomic_write(folder / f"{name}.npy") as temporary:
            np.save(temporary, values)
    names = {"name": path.stem, "source": calibration.source, "measured": {}}
    fields = merged(stated, names | calibration.fields)
    fields["measured"] = {**stated.get("measured", {}), **measured, "fit": "exact"}
    if "crosstalk" in arrays:
        fields["crosstalk"]["kernel"] = {"path": f"{folder.name}/crosstalk.npy"}
    text = strict_yaml.dump(fields)
    files.write_text(path, f"# Written by megalopta spadcam calibrate.\n{text}")


def _filled(values: Floats) -> Floats:
    return np.where(np.isfinite(values), values, np.nanmedian(values))


def primary(
    estimate: Estimate, kernel: estimates.Kernel | None, talk: tuple[Crosstalk, float] | None = None
) -> Estimate:
    """Return rates without events of neighbors and traps, which the simulation adds again.

    The crosstalk, and the error of its mean, is `talk`, or that of the kernel, with its
    afterpulses. The interval includes the error of what is subtracted, which all pixels share.
    """
    value = estimate.value
    fired, error = np.zeros_like(value), np.zeros_like(value)
    if kernel is not None and kernel.are_afterpulses_seen:
        fired, error = kernel.afterpulses * value, kernel.afterpulses_error * value
    if (talk := talk or (kernel and kernel.seen)) is not None:
        by_light = crosstalk.fired_mean(_filled(value), talk[0])
        fired = fired + by_light
        error = np.hypot(error, talk[1] / talk[0].mean_fired_neighbors * by_light)
    below = np.hypot(value - estimate.low, _95 * error)
    above = np.hypot(estimate.high - value, _95 * error)
    return Estimate(value - fired, value - fired - below, value - fired + above)


_Calibrated = tuple[Calibration, tuple[int, ...], list[tuple[float, Step]]]
"""Calibration, (rows, columns), and for EMVA 1288 exposure (s) and readings of each recording"""


def _of_recorded_codes(sources: Sequence[Source], beam: Beam, sensor: Sensor) -> _Calibrated:
    levels, steps, counter = [], [], sensor.counter
    if not isinstance(counter, AnalogCounter) or counter.adc_bits is None:
        raise ValueError(f"{sensor.name}: no analog counter with an ADC; choose spadcam")
    for source in sources:
        recording, light_hz = read_recorded(source), beam.photons_hz(source.light, sensor)
        assert recording.codes is not None
        level = Level(recording.codes, source.exposure_s or recording.exposure_s, light_hz)
        levels.append(level)
        steps.append((level.exposure_s, Step.of(light_hz * level.exposure_s, level.signal)))
    device = calibrate_device(levels, counter, sensor.dead_time)
    return calibration_of(device, sensor, beam.wavelength_nm), device.hot.shape, steps


def _of_recorded_counts(sources: Sequence[Source], beam: Beam, sensor: Sensor) -> _Calibrated:
    levels, steps = [], []
    for source in sources:
        recorded, light_hz = read_recorded(source), beam.photons_hz(source.light, sensor)
        exposure_s = recorded.exposure_s / (source.sums or 1)
        with refused_as(str(source.path)):
            if source.sums:
                level = counts.summed_bits(recorded.counts, source.sums, exposure_s, light_hz)
            else:
                level = counts.summed(
                    recorded.counts, exposure_s, light_hz, is_binary=recorded.is_binary
                )
        levels.append(level._replace(name=source.path.name))
        photons, of = level.light_hz * level.exposure_s, level.of
        steps.append((level.exposure_s, Step(photons, of.mean, of.variance, of.frames)))
    if bits := _summed_bits(levels):
        say(
            f"readings scatter as sums of about {bits} binary frames do: if they are, state their "
            "number as sums, and the exposure of one of them, in recording.yaml"
        )
    device = counts.calibrate_counts(levels, sensor.dead_time)
    if device.dark_counts_hz is None and device.efficiency is None:
        raise ValueError("; ".join(map(": ".join, device.refused.items())))
    calibration = calibration_of(device, sensor, beam.wavelength_nm)
    if len(summed := {source.sums or 1 for source in sources}) == 1:
        (sums,) = summed
        lit = [level.exposure_s for level in levels if level.light_hz] or [levels[0].exposure_s]
        calibration.fields["exposure_s"] = sums * mode(lit)
        calibration.fields["counter"] |= {"sums": sums} if sums > 1 else {}
    return calibration, device.bad.shape, steps


def _summed_bits(levels: Sequence[counts.Summed]) -> int | None:
    """Number of binary frames, about 2ⁿ − 1, of which readings may be sums; None if of none.

    A binomial distribution of N has a variance of mean · (1 − mean/N).
    """
    lit = [level.of for level in levels if level.light_hz and not level.is_binary]
    mean = np.array([of.mean.mean() for of in lit])
    bright = np.flatnonzero(mean > mean.max(initial=0) / 10)  # where the variance shows it
    missing = [float((lit[at].mean - lit[at].variance).sum()) for at in bright]
    if min(missing, default=0) <= 0 or mean.max() < 2 * mean[bright].min():
        return None
    numbers = np.array([float((lit[at].mean ** 2).sum()) for at in bright]) / missing
    bits = 2 ** round(np.log2(numbers[mean[bright].argmax()])) - 1
    variance = np.array([float(lit[at].variance.sum()) for at in bright])
    readings = np.array([lit[at].frames * lit[at].mean.size for at in bright])
    tolerance = 0.02 + 3 * np.sqrt(2 / readings) * variance / missing
    is_constant = (abs(numbers / bits - 1) < tolerance).all()  # unlike that of dead time
    return bits if is_constant and mean.max() > 0.3 * bits else None


def calibration_of(
    device: counts.CountingDevice, base: Sensor, wavelength_nm: float | None
) -> Calibration:
    """Return what the file and the page of a camera hold.

    Without wavelength, efficiency is relative.
    """
    talk, kernel = _crosstalk_of_hot_pixels(device), device.kernel
    calibration = Calibration("calibrated from recordings of counts or bits", {"counter": {}})
    fields, maps, masks = calibration.fields, calibration.maps, calibration.masks
    quantities, dead_time = device.quantities, base.dead_time
    if device.dead_time is not None:
        dead_time = device.dead_time.recovery.dead_time
        fields["dead_time"] = dead_time.model_dump(exclude_defaults=True)
    if (dark := device.dark_counts_hz) is not None:
        maps["dark_counts"] = primary(dark, kernel, talk)
    if (efficiency := device.efficiency) is not None:
        nominal, unit = float(np.nanmean(efficiency.value)), "of the median"
        scale = 1 / efficiency.median
        if wavelength_nm is not None:
            nominal = float(base.photon_detection_efficiency(np.array(wavelength_nm)))
            unit, scale, fields["fill_factor"] = "%", 100.0, base.fill_factor
        quantities[len(maps)] = Quantity("efficiency", unit, efficiency, scale)
        # errors of a fitted recovery are part of its interval
        if kernel is not None and device.dead_time is not None and device.dead_time.recovery.fired:
            kernel = kernel._replace(afterpulses_error=0.0)
        net = primary(efficiency, kernel, talk)
        if wavelength_nm is not None and np.mean(net.low > 1) > 0.5:
            raise ValueError(
                f"efficiency is {number(100 * net.median)} %, more counts than photons; check LIGHT"
                " (photons per second, not per exposure, on a whole pixel; with --beam-area-mm2 "
                "watts) and exposure of the lit recordings"
            )
        maps["efficiency"] = net.scaled(1 / nominal)
    dark = maps.get("dark_counts")
    if dark is not None and np.isfinite(dark.value).any():  # at least as hot as all that are known
        too_hot = np.isnan(dark.value) & device.hot
        dark = replace(dark, value=np.where(too_hot, np.nanmax(dark.value), dark.value))
        maps["dark_counts"] = dark
    for name, rates in maps.items():  # dead pixels count nothing, other bad ones are unknown
        maps[name] = rates.where(~device.stuck & ~device.saturated).where(~device.dead, 0.0)
    if kernel is not None and kernel.are_afterpulses_seen:
        # without dead time frames do not show the delay; a shorter one hides them
        dead_s = dead_time.dead_time_s
        delay_s = max(base.afterpulsing.delay_s, 5.0 * dead_s)
        if device.dead_time is not None and device.dead_time.recovery.fired:
            delay_s = device.dead_time.recovery.delay_s
        carriers = kernel.afterpulses * float(np.exp(dead_s / delay_s))
        fields["afterpulsing"] = {"mean_carriers": min(carriers, 0.95), "delay_s": delay_s}
    if (fired := talk or (kernel and kernel.seen)) is not None:
        fields["crosstalk"] = fired[0].model_dump(exclude_defaults=True, exclude={"kernel"})
        if fired[0].kernel:
            masks["crosstalk"] = np.array(fired[0].kernel)
    masks |= {"bad": device.bad, "hot": device.hot}
    if (switching := device.telegraph) is not None:  # its traps add the rest of the dark counts
        at, dark = switching.pixels, maps["dark_counts"]
        low_hz = np.where(at, switching.low_hz, dark.value)
        maps["dark_counts"] = replace(dark.where(~at), value=low_hz)
        steps = np.zeros(at.shape)
        steps[at] = switching.high_hz[at] / switching.low_hz[at] - 1
        step = float(np.median(steps[at]))
        masks["telegraph"] = steps / step
        times = dict.fromkeys(("fastest_s", "slowest_s"), switching.time_s)
        fields["telegraph"] = {"share": float(at.mean()), "step": step, **times}
    if (device.reading >= 0).any():
        masks["stuck"] = device.reading
    if isinstance(device, AnalogDevice):
        calibration = _with_comb(calibration, device)
    else:
        fields["counter"]["kind"] = "digital"
        if device.capacity is not None:
            fields["counter"]["capacity"] = device.capacity
    source = calibration.source
    if device.refused:
        source += f"; {' and '.join(device.refused)} of {base.name}"
    return replace(
        calibration, source=source, quantities=quantities, sections=pages.parts(device, talk),
        summary=device.summary(quantities, talk, base.name),
    )  # fmt: skip


def _with_comb(calibration: Calibration, device: AnalogDevice) -> Calibration:
    """Add the parameters of an analog counter."""
    fall, leak, step = device.offset_v, device.leak_v_s, device.step_v
    offset = Estimate(-fall.value, -fall.high, -fall.low)  # a voltage drop as a rise
    calibration.maps.update(step=step, leak=leak, offset=offset)
    counter = calibration.fields["counter"]
    counter |= {"step_v": step.median, "step_sigma_v": 0.0}
    if np.isfinite(leak.value).any():
        counter |= {"leak_v_s": max(leak.median, 0.0), "leak_sigma_v_s": 0.0}
    counter["read_noise_v"] = device.read_noise_v.median
    if device.is_slope_seen:
        counter["step_slope"] = device.curve.slope
    source = f"calibrated by comb from {len(device.drops.exposure_s)} recordings"
    return replace(calibration, source=source)


def _crosstalk_of_hot_pixels(device: counts.CountingDevice) -> tuple[Crosstalk, float] | None:
    """Crosstalk of hot pixels, and the error of its mean, where coincidences are less precise."""
    dark, kernel = device.dark_counts_hz, device.kernel
    if dark is None or dark.value.size < estimates.FEWEST_PIXELS:
        return None
    rates = np.where(device.bad, np.nan, dark.value)
    try:
        talk, error = estimates.kernel_of(estimates.crosstalk_of_hot_pixels(rates))
    except ValueError:  # too many bad pixels
        return None
    if not talk.is_on or (kernel is not None and float(kernel.error.mean()) < error):
        return None
    places = (np.array(talk.kernel) > 0).sum() / estimates.PERIOD**2
    return talk, error * float(np.sqrt(places))


def write_array_device(path: Path, tables: Sequence[Measurement], base: str, source: str) -> str:
    """Write the device file of an array from its tables; return a summary in a sentence.

    Raises ValueError if a table does not suffice, or two are of one kind.
    """
    by_kind: dict[Any, Any] = {type(table): table for table in tables}
    if len(by_kind) < len(tables):
        raise ValueError("2 tables of one kind; give those of one array")
    if (rates := by_kind.get(np.ndarray)) is None:
        raise ValueError("no map of dark counts; give a table of them")
    pairs, lags = by_kind.get(estimates.PairCrosstalk), by_kind.get(Autocorrelation)
    talk = estimates.fit_crosstalk(pairs) if pairs else Crosstalk()
    # later afterpulses count as dark counts
    pulses = fit_table(lags.of(slice(None), 8e-6)) if lags else Afterpulsing()
    counted = _filled(rates)
    dark = np.maximum(counted - crosstalk.fired_mean(counted, talk), 0)
    fields = {}
    for name, effect in (("crosstalk", talk), ("afterpulsing", pulses)):
        if effect.is_on:
            fields[name] = effect.model_dump(mode="json", exclude_defaults=True)
    summary = (
        f"{rates.size} pixel{'s' * (rates.size > 1)}, {int(np.isnan(rates).sum())} unknown; "
        f"dark counts {number(float(np.nanmedian(rates)))} Hz (median), crosstalk "
        f"{number(100 * talk.mean_fired_neighbors)} %, afterpulses "
        f"{number(100 * pulses.mean_carriers)} %"
    )
    masks = {"dark_counts": dark * (1 - pulses.mean_carriers)}
    write_device(path, Calibration(source, fields, masks=masks), base)
    return summary
