"""Device file and page of a counting or binary camera, from its recordings."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from megalopta.camera.calibration import (
    Quantity,
    coincident_fields,
    nominal_efficiency,
    pixel_sections,
    primary,
)
from megalopta.camera.device_files import filled, save_map, write_device_file, write_maps
from megalopta.camera.emva_page import emva_section
from megalopta.camera.recording import Beam, Source, read_recorded
from megalopta.report.sections import Section, write_sections
from megalopta.report.text import number, with_error
from megalopta.sensor import Sensor, preset
from megalopta.sensor.calibrate.counting import CountingDevice, DeadTimeEstimate, calibrate_counts
from megalopta.sensor.calibrate.device import Estimate
from megalopta.sensor.calibrate.emva import Step
from megalopta.sensor.calibrate.hot_neighbors import (
    FEWEST_PIXELS,
    crosstalk_of_hot_pixels,
    kernel_of,
)
from megalopta.sensor.calibrate.neighbors import Kernel
from megalopta.sensor.calibrate.sums import Summed, summed, summed_bits
from megalopta.sensor.effects.crosstalk import REACH, Crosstalk, fired_mean, neighborhoods

_PIXELS = (
    "Median over pixels, range of 90 % of them, and median half width of a pixel's 95 % CI. These "
    "rates include events that crosstalk and afterpulses add. The maps of the device file exclude "
    "them where crosstalk and afterpulses are found below."
)
_CROSSTALK = (
    "Probability that an avalanche fires a pixel, from the dark counts of hot pixels and of those "
    "around them. In some arrays rows come in pairs, and crosstalk is mostly within a pair."
)
_COINCIDENCES = (
    "Crosstalk from pixels up to two apart that fire together more often than by chance, and "
    "afterpulses from the variance that it does not explain. Three standard errors are the limit "
    "of detection. Crosstalk within pairs of rows is told by hot pixels alone. If these show none, "
    "the device file gets the values that exceed the limit."
)
_DEAD_TIME = (
    "Of the two kinds without twilight pulses and recharging; short twilight looks like a shorter "
    "dead time. Its interval has what the delay of afterpulses leaves open."
)
_EDGES: dict[str, Any] = {
    "the pixel above": (REACH - 1, REACH),
    "the pixel below": (REACH + 1, REACH),
    "left and right, each": (REACH, [REACH - 1, REACH + 1]),
    "corners, each": ([REACH - 1, REACH - 1, REACH + 1, REACH + 1],
                      [REACH - 1, REACH + 1, REACH - 1, REACH + 1]),
}  # fmt: skip
_BAD = (
    "Dead: no counts under light; stuck: one reading in all frames; saturated: at the counter's "
    "end in every recording; hot: significantly above ten times the median dark counts; telegraph: "
    "dark counts switch between two rates. The file bad.npy marks the first three, hot.npy and "
    "telegraph.npy the others; stuck.npy has the readings that do not change."
)


def calibrate_counting(sources: Sequence[Source], out: Path, beam: Beam, base: str) -> str:
    """Write the device file of a camera of counts or bits, its maps and report; return a summary.

    Raises ValueError or UserError as `calibrating.calibrate_recordings`.
    """
    sensor = preset(base)
    levels = [_summed(source, beam, sensor) for source in sources]
    dead = sensor.dead_time
    known = None if dead.kind == "ideal" else (dead.dead_time_s, dead.kind)
    found = calibrate_counts(levels, known)
    if found.dark_counts_hz is None and found.efficiency is None:
        raise ValueError(_reasons(found))
    talk = hot_crosstalk(found)
    write_counting_device(out, found, talk, sensor, beam.wavelength_nm, base)
    recorded = [
        (
            each.exposure_s,
            Step(each.light_hz * each.exposure_s, each.mean, each.variance, each.frames),
        )
        for each in levels
    ]
    standard = emva_section(out, found.bad.shape, beam.wavelength_nm, recorded)
    sections = [_crosstalk_section(talk, found.bad.size), _coincidences(found.kernel), standard]
    _write_report(out.with_suffix(".html"), found, sections, out.stem, beam.wavelength_nm is None)
    return counting_summary(found, beam.wavelength_nm is None)


def _summed(source: Source, beam: Beam, sensor: Sensor) -> Summed:
    recorded = read_recorded(source)
    light_hz = beam.photons_hz(source.light, sensor)
    if source.sums and recorded.is_binary:
        raise ValueError(f"{source.path}: sums: {source.sums}, but its frames are bits; omit sums")
    try:
        if source.sums:
            return summed_bits(recorded.counts, source.sums, recorded.exposure_s, light_hz)
        return summed(recorded.counts, recorded.exposure_s, light_hz, is_binary=recorded.is_binary)
    except ValueError as problem:
        raise ValueError(f"{source.path}: {problem}") from problem


def hot_crosstalk(device: CountingDevice) -> Crosstalk:
    """Return crosstalk as the dark counts of hot pixels and their neighbors show it, or none.

    None for bits, which the sensor draws without crosstalk.
    """
    dark = device.dark_counts_hz
    if dark is None or device.capacity == 1 or dark.value.size < FEWEST_PIXELS:
        return Crosstalk()
    try:
        return kernel_of(crosstalk_of_hot_pixels(np.where(device.bad, np.nan, dark.value)))
    except ValueError:  # too many bad pixels
        return Crosstalk()


def _primary(estimate: Estimate, device: CountingDevice, talk: Crosstalk) -> Estimate:
    """Rates without what neighbors and traps fire, which the simulation adds again."""
    if not talk.is_on:
        return primary(estimate, device.kernel)
    fired = fired_mean(filled(estimate.value), talk)
    return Estimate(*(each - fired for each in (estimate.value, estimate.low, estimate.high)))


def write_counting_device(
    path: Path,
    device: CountingDevice,
    talk: Crosstalk,
    base: Sensor,
    wavelength_nm: float | None,
    name: str,
) -> None:
    """Write a device file, and its maps with intervals and masks to a folder next to it.

    `base`, a preset of this `name`, supplies everything that is not measured. Without
    `wavelength_nm` the efficiency is relative. Maps are without what crosstalk adds.
    """
    folder = path.with_suffix("")
    maps = {}
    if device.dark_counts_hz is not None:
        dark = _without(_primary(device.dark_counts_hz, device, talk), device)
        if (switching := device.telegraph) is not None:  # its traps add the rest
            unknown = np.where(switching.pixels, np.nan, [dark.low, dark.high])
            dark = Estimate(np.where(switching.pixels, switching.low_hz, dark.value), *unknown)
        maps["dark_counts"] = dark
    if device.efficiency is not None:
        nominal = nominal_efficiency(device.efficiency, base, wavelength_nm)
        found = _primary(device.efficiency, device, talk).scaled(1 / nominal)
        maps["efficiency"] = _without(found, device)
    fields: dict[str, Any] = {
        "preset": name,
        "name": path.stem,
        "source": "calibrated from recordings of counts or bits",
        "measured": {**write_maps(folder, maps), "fit": "exact"},
    }
    counter: dict[str, Any] = {"kind": "digital"}
    if device.capacity is not None:
        counter["capacity"] = device.capacity
    fields["counter"] = counter
    if device.dead_time is not None:
        dead = device.dead_time
        fields["dead_time"] = {"kind": dead.kind, "dead_time_s": dead.seconds}
    fields |= _switching(device, folder, fields["measured"])
    if talk.is_on:
        save_map(folder / "crosstalk.npy", np.array(talk.kernel))
        fields["crosstalk"] = {
            "mean_fired_neighbors": talk.mean_fired_neighbors,
            "kernel": {"path": f"{folder.name}/crosstalk.npy"},
        }
    else:
        fields |= coincident_fields(device.kernel, fields, base)
    if (device.reading >= 0).any():
        save_map(folder / "stuck.npy", device.reading)
        fields["measured"]["stuck"] = f"{folder.name}/stuck.npy"
    save_map(folder / "bad.npy", device.bad)
    save_map(folder / "hot.npy", device.hot)
    write_device_file(path, fields)


def _switching(device: CountingDevice, folder: Path, measured: dict[str, Any]) -> dict[str, Any]:
    """Field of the pixels with telegraph noise, whose map is written; empty if there are none."""
    found = device.telegraph
    if found is None:
        return {}
    steps = np.zeros(found.pixels.shape)
    steps[found.pixels] = found.high_hz[found.pixels] / found.low_hz[found.pixels] - 1
    step = float(np.median(steps[found.pixels]))
    save_map(folder / "telegraph.npy", steps / step)
    measured["telegraph"] = f"{folder.name}/telegraph.npy"
    times = dict.fromkeys(("fastest_s", "slowest_s"), found.time_s)
    return {"telegraph": {"share": float(found.pixels.mean()), "step": step, **times}}


def _without(estimate: Estimate, device: CountingDevice) -> Estimate:
    """Estimate in which dead pixels count nothing, and other bad ones are unknown."""
    unknown = device.stuck | device.saturated
    return Estimate(
        *(
            np.where(device.dead, 0.0, np.where(unknown, np.nan, each))
            for each in (estimate.value, estimate.low, estimate.high)
        )
    )


def counting_summary(device: CountingDevice, is_relative: bool) -> str:
    """Return the estimates, medians over the pixels, and what is missing, on one line."""
    medians = [
        f"{title} {number(scale * float(np.nanmedian(estimate.value)))} {unit}"
        for title, unit, estimate, scale in _quantities(device, is_relative)
    ]
    if device.dead_time is not None:
        dead = device.dead_time
        medians.append(
            f"dead time {with_error(dead.seconds, 1.96 * dead.error, 's')} ({_kind(dead)})"
        )
    switching = 0 if device.telegraph is None else int(device.telegraph.pixels.sum())
    noisy = f", {switching} with telegraph noise" if switching else ""
    missing = f" Not known: {_reasons(device)}." if device.refused else ""
    return (
        f"{device.bad.size} pixels, {int(device.bad.sum())} bad, {int(device.hot.sum())} hot"
        f"{noisy}; medians: {', '.join(medians)}.{missing}"
    )


def _kind(dead: DeadTimeEstimate) -> str:
    return dead.kind if dead.is_kind_clear else f"kind undetermined, taken as {dead.kind}"


def _reasons(device: CountingDevice) -> str:
    return "; ".join(f"{name}: {reason}" for name, reason in device.refused.items())


def _quantities(device: CountingDevice, is_relative: bool) -> Iterator[Quantity]:
    """Yield all estimates per pixel."""
    if device.dark_counts_hz is not None:
        yield "dark counts", "Hz", device.dark_counts_hz, 1.0
    if device.efficiency is not None:
        median = float(np.nanmedian(device.efficiency.value))
        scale, unit = (1 / median, "of the median") if is_relative else (100.0, "%")
        yield "efficiency", unit, device.efficiency, scale


def _crosstalk_section(talk: Crosstalk, pixels: int) -> Section:
    title = "Crosstalk of hot pixels"
    if not talk.is_on:
        few = f"; needs {FEWEST_PIXELS} pixels" if pixels < FEWEST_PIXELS else ""
        return Section(title, f"None found{few}.")
    chances = neighborhoods(talk).mean(axis=1)  # of pixels in even and in odd rows
    rows = tuple(
        (name, *(f"{100 * float(each[at].mean()):.2f} %" for each in chances))
        for name, at in _EDGES.items()
    )
    total = (f"{100 * float(each.sum()):.2f} %" for each in chances)
    return Section(title, _CROSSTALK, ("fires", "in even rows", "in odd rows"),
                   (*rows, ("all pixels around", *total)))  # fmt: skip


def _coincidences(kernel: Kernel | None) -> Section | None:
    if kernel is None:
        return None
    rows = (
        ("fired neighbors per event", 2 * float(kernel.share.sum()), kernel.total_error),
        ("afterpulses per event", kernel.afterpulses, kernel.afterpulses_error),
    )
    texts = tuple((name, with_error(100 * each, 196 * error, "%")) for name, each, error in rows)
    return Section("Coincidences in the dark", _COINCIDENCES, ("", "95 % CI"), texts)


def _write_report(
    path: Path, device: CountingDevice, more: list[Section | None], name: str, is_relative: bool
) -> None:
    table, maps = pixel_sections([*_quantities(device, is_relative)], _PIXELS, "Gray: unknown.")
    kinds = ("dead", "stuck", "saturated", "hot")
    bad = tuple((kind, str(int(getattr(device, kind).sum()))) for kind in kinds)
    switching = 0 if device.telegraph is None else int(device.telegraph.pixels.sum())
    bad = (*bad, ("telegraph", str(switching)))
    dead = device.dead_time
    rows = () if dead is None else (
        ("dead time (95 % CI)", with_error(dead.seconds, 1.96 * dead.error, "s")),
        ("its kind", _kind(dead)),
    )  # fmt: skip
    sections = [
        table,
        Section("Dead time", _DEAD_TIME, ("", "estimate"), rows) if rows else None,
        Section("Not known", f"{_reasons(device)}.") if device.refused else None,
        Section("Bad and hot pixels", _BAD, ("", "pixels"), bad),
        maps,
        *more,
    ]
    write_sections(path, f"Calibration of {name}", counting_summary(device, is_relative), sections)
