"""The calibration report."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from markupsafe import Markup

from megalopta.camera.calibration_charts import (
    map_chart,
    photon_transfer_chart,
    residual_chart,
    residuals,
    saturation_chart,
)
from megalopta.plotting.sections import Section, captioned, write_sections
from megalopta.plotting.text import number
from megalopta.sensor.calibrate.device import Device, Estimate
from megalopta.sensor.calibrate.neighbors import OFFSETS, Kernel

_FITTED = 2
"""Efficiency and dead time; dark counts are told by dark frames."""
_MAPS = (
    "Grain is the scatter of pixels and of their estimates; gradients are uneven light (in the "
    "efficiency) or warmth (in the dark counts), rows and columns the readout. What is not told is "
    "gray."
)


def write_calibration_report(path: Path, device: Device, name: str, is_relative: bool) -> None:
    """Write what was found of a device, with pictures."""
    sections = [
        Section(
            "The pixels",
            "Median over the pixels, the range of nine in ten, and the median half width of a "
            "pixel's 95 % interval.",
            ("", "median", "from", "to", "± (95 %)"),
            tuple(_row(*each) for each in _quantities(device, is_relative)),
        ),
        Section(
            "Photon transfer and saturation",
            f"Steps are from the {device.method}. {_slope(device)} {_kind(device)}".strip(),
            charts=tuple(_curves(device)),
        ),
    ]
    if device.kernel is not None:
        sections.append(_neighbors(device.kernel))
    maps = [
        map_chart(scale * estimate.value, f"map-{at}", f"{title} ({unit})")
        for at, (title, unit, estimate, scale) in enumerate(_quantities(device, is_relative))
        if np.isfinite(estimate.value).any()
    ]
    sections.append(Section("Maps", _MAPS, charts=tuple(maps)))
    write_sections(path, f"Calibration of {name}", summary(device), sections)


def summary(device: Device) -> str:
    """What was found, in one or two sentences."""
    known = int(np.isfinite(device.step_v.value).sum())
    text = (
        f"{known} of {device.hot.size} pixels, {number(1e3 * _median(device.step_v))} mV per "
        f"event, {number(_median(device.dark_counts_hz))} dark counts per second (median), "
        f"{int(device.hot.sum())} hot"
    )
    if device.dead_time_s is not None:
        kind = device.dead_time_kind or "of a kind that the curve does not tell"
        text += f"; dead time {number(1e6 * _median(device.dead_time_s))} µs, {kind}"
    if not np.isfinite(device.leak_v_s.value).any():
        text += ". Read noise hides single events: leak counts as dark counts"
    return f"{text}."


def _median(estimate: Estimate) -> float:
    return float(np.nanmedian(estimate.value))


def _quantities(device: Device, is_relative: bool) -> list[tuple[str, str, Estimate, float]]:
    found = [
        ("dark counts", "Hz", device.dark_counts_hz, 1.0),
        ("step", "mV", device.step_v, 1e3),
        ("offset", "mV", device.offset_v, 1e3),
        ("leak", "mV/s", device.leak_v_s, 1e3),
        ("read noise", "mV", device.read_noise_v, 1e3),
    ]
    if device.efficiency is not None and device.dead_time_s is not None:
        scale = 1 / _median(device.efficiency) if is_relative else 100.0
        unit = "of the median" if is_relative else "%"
        found.append(("efficiency", unit, device.efficiency, scale))
        found.append(("dead time", "µs", device.dead_time_s, 1e6))
    return found


def _row(title: str, unit: str, estimate: Estimate, scale: float) -> tuple[str, ...]:
    if not np.isfinite(estimate.value).any():
        return (f"{title} ({unit})", "not told", "", "", "")
    low, median, high = scale * np.nanpercentile(estimate.value, (5, 50, 95))
    widths = scale * (estimate.high - estimate.low) / 2
    half = float(np.nanmedian(widths)) if np.isfinite(widths).any() else np.nan
    return (f"{title} ({unit})", *(number(float(each)) for each in (median, low, high, half)))


def _kind(device: Device) -> str:
    if device.efficiency is None:
        return ""
    if device.dead_time_kind is None:
        return "The curve does not tell the kind of dead time; brighter light would."
    ratio = f"e^{device.kind_ratio:.0f} times as likely as the other kind"
    return f"The dead time is {device.dead_time_kind}: {ratio}."


def _curves(device: Device) -> Iterator[Markup]:
    yield captioned(
        photon_transfer_chart(device, "transfer"),
        "A point for each pixel and level: where they lie on the line, the noise is that of single "
        "events; light falls below it where dead time evens events out.",
    )
    if device.efficiency is None:
        return
    yield captioned(
        saturation_chart(device, "saturation"),
        "Counts of the median pixel: how far they stay below the line without dead time is the "
        "dead time; its kind is told where the two laws part.",
    )
    z = residuals(device)
    expected = np.sqrt(max(1 - _FITTED / len(z), 0.0))
    yield captioned(
        residual_chart(device, "residuals"),
        f"What the fits of the saturation curve leave: {np.sqrt(np.nanmean(z**2)):.2f} standard "
        f"errors, about {expected:.2f} where the law holds ({len(z)} lights, {_FITTED} numbers of "
        "each pixel fitted to them); more is light that was not even or not steady.",
    )


def _slope(device: Device) -> str:
    if not np.isfinite(device.slope_error):
        return "Whether the step changes over the swing is not told."
    value, error = 100 * device.curve.slope, 196 * device.slope_error
    way = f"{value:+.3g} ± {error:.2g} % (95 %)"
    seen = "changes" if device.is_slope_seen else "does not change, as far as can be seen,"
    return f"The step {seen} over the swing: {way} smaller at its bottom than at its top."


def _neighbors(kernel: Kernel) -> Section:
    names = (
        "right and left",
        "below and above",
        "diagonal",
        "other diagonal",
        "two aside",
        "two above",
    )
    rows = [
        (f"{name} {offset}", f"{100 * share:.3f} %", f"± {196 * error:.3f} %")
        for name, offset, share, error in zip(
            names, OFFSETS, kernel.share, kernel.error, strict=True
        )
    ]
    pulses = f"{100 * kernel.afterpulses:.2f} %", f"± {196 * kernel.afterpulses_error:.2f} %"
    if np.isnan(kernel.afterpulses):
        pulses = "not told", "read noise hides them"
    seen = "Crosstalk is seen." if kernel.is_seen else "No crosstalk is seen."
    traps = "Afterpulses are seen." if kernel.are_afterpulses_seen else "No afterpulses are seen."
    return Section(
        "Crosstalk and afterpulses",
        f"{seen} {traps} Probability that an event fires a pixel, from coincidences in the dark; "
        "afterpulses within the exposure, from the variance of dark counts. What is seen is in the "
        "device file. How long after, frames do not tell: five dead times are assumed.",
        ("neighbor", "probability", "95 %"),
        (*rows, ("afterpulses", *pulses)),
    )
