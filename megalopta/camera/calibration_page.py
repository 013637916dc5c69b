"""The calibration page: what was found of a device, as tables, curves and maps."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from markupsafe import Markup

from megalopta.camera.device_charts import (
    falls_chart,
    map_chart,
    residual_chart,
    saturation_chart,
    saturation_residuals,
)
from megalopta.plotting.sections import Section, captioned, write_sections
from megalopta.plotting.text import number
from megalopta.sensor.calibrate.device import Device, Estimate
from megalopta.sensor.calibrate.neighbors import OFFSETS

_FITTED = 2
"""Efficiency and dead time; dark counts are told by dark frames."""
_UNKNOWN = "not known"
_PIXELS = (
    "Median over the pixels, the range of nine in ten, and the median half width of a pixel's 95 % "
    "interval. Where read noise hides single events, leak counts as dark counts."
)
_CURVES = (
    "A step may change over the swing. Where the saturation curve does not tell the kind of dead "
    "time, brighter light would."
)
_NEIGHBORS = (
    "Probability that an event fires a pixel, from coincidences in the dark; afterpulses within "
    "the exposure, from the variance of dark counts, which read noise may hide. What is seen is in "
    "the device file. How long after, frames do not tell: five dead times are assumed."
)
_MAPS = (
    "Grain is the scatter of pixels and of their estimates; gradients are uneven light (in the "
    "efficiency) or warmth (in the dark counts), rows and columns the readout. What is not known "
    "is gray."
)
_NAMES = "right and left", "below and above", "diagonal", "other diagonal", "two aside", "two above"


def write_calibration_report(path: Path, device: Device, name: str, is_relative: bool) -> None:
    """Write what was found of a device, with pictures; relative is light of no known wavelength."""
    found = _quantities(device, is_relative)
    maps = (
        map_chart(scale * estimate.value, f"map-{at}", f"{title} ({unit})")
        for at, (title, unit, estimate, scale) in enumerate(found)
        if np.isfinite(estimate.value).any()
    )
    head = ("", "median", "from", "to", "± (95 %)")
    sections = [
        Section("The pixels", _PIXELS, head, tuple(_row(*each) for each in found)),
        Section(
            "Photon transfer and saturation",
            _CURVES,
            ("", "found", "how sure"),
            _laws(device),
            tuple(_curves(device)),
        ),
        *_neighbors(device),
        Section("Maps", _MAPS, charts=tuple(maps)),
    ]
    write_sections(path, f"Calibration of {name}", calibration_summary(device), sections)


def calibration_summary(device: Device) -> str:
    """Return what was found, medians over the pixels, on one line."""
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


def _quantities(device: Device, is_relative: bool) -> list[tuple[str, str, Estimate, float]]:
    """Return name, unit, estimate and factor to that unit of all that was estimated of pixels."""
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


def _row(title: str, unit: str, estimate: Estimate, scale: float) -> tuple[str, ...]:
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
    likely = f"e^{device.kind_ratio:.0f} times as likely as the other"
    kind = device.dead_time_kind
    return (
        ("steps are from", device.method, ""),
        (
            "step at the bottom of the swing, less than at its top by",
            f"{slope:+.3g} ± {error:.2g} % (95 %)" if is_known else _UNKNOWN,
            seen if is_known else "",
        ),
        ("kind of dead time", kind or _UNKNOWN, likely if kind else ""),
    )


def _curves(device: Device) -> Iterator[Markup]:
    yield captioned(
        falls_chart(device),
        "A point for each pixel and level: where they lie on the line, the noise is that of single "
        "events; light falls below it where dead time evens events out.",
    )
    if device.efficiency is None:
        return
    yield captioned(
        saturation_chart(device),
        "Counts of the median pixel: how far they stay below the line without dead time is the "
        "dead time; its kind shows where the two laws part.",
    )
    z = saturation_residuals(device)
    expected = np.sqrt(max(1 - _FITTED / len(z), 0.0))
    yield captioned(
        residual_chart(device),
        f"What the fits of the saturation curve leave: {np.sqrt(np.nanmean(z**2)):.2f} standard "
        f"errors, about {expected:.2f} where the law holds ({len(z)} lights, {_FITTED} numbers of "
        "each pixel fitted to them); more is light that was not even or not steady.",
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
            _UNKNOWN if np.isnan(share) else f"{100 * share:.3f} %",
            f"± {196 * error:.3f} %",
            "yes" if is_seen else "no",
        )
        for name, share, error, is_seen in zip(
            [*names, "afterpulses"], shares, errors, seen, strict=True
        )
    ]
    head = ("neighbor", "probability", "95 %", "seen")
    yield Section("Crosstalk and afterpulses", _NEIGHBORS, head, tuple(rows))
