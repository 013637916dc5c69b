"""Device file and page of a counting or binary camera, from its recordings."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from megalopta.camera.calibration import estimate_row
from megalopta.camera.device_files import save_map, write_maps
from megalopta.camera.emva_page import emva_section
from megalopta.camera.recording import Beam, Source, read_recorded
from megalopta.core import strict_yaml
from megalopta.core.files import write_text
from megalopta.plotting.sections import Section, write_sections
from megalopta.plotting.svg import map_chart
from megalopta.plotting.text import number
from megalopta.sensor import Sensor, preset
from megalopta.sensor.calibrate.counting import CountingDevice, Summed, calibrate_counts, summed
from megalopta.sensor.calibrate.device import Estimate
from megalopta.sensor.calibrate.emva import Step
from megalopta.sensor.calibrate.saturation import DeadTimeKind

_KINDS: dict[str, DeadTimeKind] = {
    "paralyzable": "paralyzable",
    "nonparalyzable": "nonparalyzable",
}
_PIXELS = (
    "Median over pixels, range of 90 % of them, and median half width of a pixel's 95 % CI. Events "
    "that crosstalk and afterpulses add are part of these rates."
)
_BAD = (
    "Dead: no counts under light; stuck: one reading in all frames; saturated: at the counter's "
    "end in every recording; hot: surely above ten times the median dark counts. The file bad.npy "
    "marks the first three, hot.npy the last."
)


def calibrate_counting(sources: Sequence[Source], out: Path, beam: Beam, base: str) -> str:
    """Write the device file of a camera of counts or bits, its maps and report; return a summary.

    Raises ValueError or UserError as `calibrating.calibrate_recordings`.
    """
    sensor = preset(base)
    levels = [_summed(source, beam, sensor) for source in sources]
    dead, kind = sensor.dead_time, _KINDS.get(sensor.dead_time.kind)
    found = calibrate_counts(levels, (dead.dead_time_s, kind) if kind else None)
    if found.dark_counts_hz is None and found.efficiency is None:
        raise ValueError(_reasons(found))
    write_counting_device(out, found, sensor, beam.wavelength_nm, base)
    recorded = [
        (
            each.exposure_s,
            Step(each.light_hz * each.exposure_s, each.mean, each.variance, each.frames),
        )
        for each in levels
    ]
    standard = emva_section(out, found.bad.shape, beam.wavelength_nm, recorded)
    _write_report(out.with_suffix(".html"), found, standard, out.stem, beam.wavelength_nm is None)
    return counting_summary(found, beam.wavelength_nm is None)


def _summed(source: Source, beam: Beam, sensor: Sensor) -> Summed:
    recorded = read_recorded(source)
    light_hz = beam.photons_hz(source.light, sensor)
    try:
        return summed(recorded.counts, recorded.exposure_s, light_hz, is_binary=recorded.is_binary)
    except ValueError as problem:
        raise ValueError(f"{source.path}: {problem}") from problem


def write_counting_device(
    path: Path, device: CountingDevice, base: Sensor, wavelength_nm: float | None, name: str
) -> None:
    """Write a device file, and its maps with intervals and masks to a folder next to it.

    `base`, a preset of this `name`, supplies everything that is not measured. Without
    `wavelength_nm` the efficiency is relative.
    """
    folder = path.with_suffix("")
    maps = {}
    if device.dark_counts_hz is not None:
        maps["dark_counts"] = _without(device.dark_counts_hz, device)
    if device.efficiency is not None:
        nominal = float(np.nanmean(device.efficiency.value))
        if wavelength_nm is not None:
            nominal = float(base.photon_detection_efficiency(np.array(wavelength_nm)))
        maps["efficiency"] = _without(device.efficiency.scaled(1 / nominal), device)
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
    save_map(folder / "bad.npy", device.bad)
    save_map(folder / "hot.npy", device.hot)
    write_text(path, f"# Written by megalopta spadcam calibrate.\n{strict_yaml.dump(fields)}")


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
        medians.append(f"dead time {number(1e9 * dead.seconds)} ns ({dead.kind})")
    missing = f" Not known: {_reasons(device)}." if device.refused else ""
    return (
        f"{device.bad.size} pixels, {int(device.bad.sum())} bad, {int(device.hot.sum())} hot; "
        f"medians: {', '.join(medians)}.{missing}"
    )


def _reasons(device: CountingDevice) -> str:
    return "; ".join(f"{name}: {reason}" for name, reason in device.refused.items())


def _quantities(
    device: CountingDevice, is_relative: bool
) -> Iterator[tuple[str, str, Estimate, float]]:
    """Yield name, unit, estimate and factor to that unit."""
    if device.dark_counts_hz is not None:
        yield "dark counts", "Hz", device.dark_counts_hz, 1.0
    if device.efficiency is not None:
        median = float(np.nanmedian(device.efficiency.value))
        scale, unit = (1 / median, "of the median") if is_relative else (100.0, "%")
        yield "efficiency", unit, device.efficiency, scale


def _write_report(
    path: Path, device: CountingDevice, standard: Section, name: str, is_relative: bool
) -> None:
    quantities = list(_quantities(device, is_relative))
    head = ("", "median", "from", "to", "± (95 % CI)")
    kinds = ("dead", "stuck", "saturated", "hot")
    bad = tuple((kind, str(int(getattr(device, kind).sum()))) for kind in kinds)
    dead = device.dead_time
    rows = () if dead is None else (
        ("dead time (ns)", f"{number(1e9 * dead.seconds)} ± {number(196e7 * dead.error)}"),
        ("its kind", dead.kind + ("" if dead.is_kind_clear else ", not certain")),
    )  # fmt: skip
    maps = tuple(
        map_chart(scale * estimate.value, f"map-{at}", f"{title} ({unit})")
        for at, (title, unit, estimate, scale) in enumerate(quantities)
    )
    sections = [
        Section("The pixels", _PIXELS, head, tuple(estimate_row(*each) for each in quantities)),
        Section("Dead time", "", ("", "estimate"), rows) if rows else None,
        Section("Not known", f"{_reasons(device) or 'Nothing'}."),
        Section("Bad and hot pixels", _BAD, ("", "pixels"), bad),
        Section("Maps", "Gray: unknown.", charts=maps),
        standard,
    ]
    summary = counting_summary(device, is_relative)
    write_sections(path, f"Calibration of {name}", summary, [each for each in sections if each])
