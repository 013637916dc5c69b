"""Section of a calibration page with the figures and pictures of EMVA 1288.

The figures are those of the calibrated device, from exact moments at 50 steps of light. If the
recordings have a dark and eight levels of light at one exposure, theirs are shown, too.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.ticker import EngFormatter

from megalopta.report.sections import Section, captioned
from megalopta.report.style import BLACK, BLUE, CHART_PT, VERMILION, in_style, new_axes, with_legend
from megalopta.report.text import number
from megalopta.sensor import changed, load_sensor
from megalopta.sensor.calibrate.emva import (
    FEWEST_STEPS,
    Emva,
    Step,
    deviations,
    device_steps,
    emva,
    without_dead_time,
)

Recorded = Sequence[tuple[float, Step]]
"""Exposure (s) and readings of each recording"""
Steps = tuple[Step, Sequence[Step]]
"""The dark, and steps of light"""

_TITLE = "EMVA 1288"
_TEXT = (
    "Release 4, Linear; an event is one electron, a reading a count. The device's figures are "
    "computed from the calibration at 50 steps of light and an exposure of {:g} s. Saturation is "
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


def emva_section(
    device: Path, shape: tuple[int, int], wavelength_nm: float | None, recorded: Recorded
) -> Section:
    """Return the section of a device file of (rows, columns) pixels, or why there is none."""
    exposures = [exposure_s for exposure_s, step in recorded if step.photons]
    if wavelength_nm is None or not exposures:
        return Section(_TITLE, "Needs recordings of light and --wavelength-nm.")
    exposure_s = max(set(exposures), key=exposures.count)
    sensor = changed(load_sensor(device), exposure_s=exposure_s)
    if sensor.counter_capacity == 1:
        return Section(_TITLE, "Needs counts: sum binary frames, 255 or more each.")
    try:
        own = device_steps(sensor, shape, wavelength_nm)
        factors = without_dead_time(sensor, shape, wavelength_nm, own[1])
        figures = [emva(*own, factors=factors)]
    except ValueError as problem:
        return Section(_TITLE, f"Not known: {problem}.")
    seen = _at(exposure_s, recorded)
    if seen and len(seen[1]) >= FEWEST_STEPS:
        seen_factors = without_dead_time(sensor, shape, wavelength_nm, seen[1])
        figures.append(emva(*seen, factors=seen_factors))
    rows = tuple(
        (symbol, title, *(number(of(each)) for each in figures), *("",) * (2 - len(figures)))
        for symbol, title, of in _ROWS
    )
    text = _TEXT.format(exposure_s, *factors)
    return Section(_TITLE, text, _HEAD, rows, tuple(_charts(own, figures[0], seen)))


def _at(exposure_s: float, recorded: Recorded) -> Steps | None:
    """Return the recordings at an exposure, if one of them is dark."""
    steps = [step for each, step in recorded if each == exposure_s]
    dark = [step for step in steps if not step.photons]
    return (dark[0], [step for step in steps if step.photons]) if dark else None


_CAPTIONS = {
    "sensitivity": "The line is the responsivity R.",
    "transfer": "Variance over mean, both less their dark values. The line is the gain K.",
    "snr": "The line is the limit of the same efficiency without noise.",
    "linearity": "Deviation from a line, over the line.",
}
_LABELS = {
    "sensitivity": ("photons per pixel", "µ_y − µ_y.dark (counts)"),
    "transfer": ("µ_y − µ_y.dark (counts)", "σ²_y − σ²_y.dark (counts²)"),
    "snr": ("photons per pixel", "SNR"),
    "linearity": ("photons per pixel", "deviation (%)"),
}


def _charts(own: Steps, found: Emva, seen: Steps | None) -> Iterator[Markup]:
    for kind, caption in _CAPTIONS.items():
        yield captioned(_chart(own, found, seen, kind), caption)


@in_style
def _chart(own: Steps, found: Emva, seen: Steps | None, kind: str) -> Markup:
    figure, axes = new_axes(*CHART_PT)
    axes.plot(*_coordinates(kind, found, *own), ".", color=BLUE, label="device")
    axes.plot(*_line(kind, found, own), color=VERMILION, linewidth=1)
    if seen and kind != "linearity":
        axes.plot(
            *_coordinates(kind, found, *seen), "o", color=BLACK, markersize=5, label="recordings"
        )
    axes.set(xlabel=_LABELS[kind][0], ylabel=_LABELS[kind][1])
    if kind == "snr":
        axes.set(xscale="log", yscale="log", ylim=(None, 2 * np.sqrt(found.saturation_electrons)))
    else:
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))
    return with_legend(figure, f"emva-{kind}", f"EMVA 1288: {axes.get_ylabel()}")


def _coordinates(kind: str, found: Emva, dark: Step, steps: Sequence[Step]) -> tuple[Any, Any]:
    """Return abscissas and ordinates of a picture."""
    signal = [step.level - dark.level for step in steps]
    if kind == "transfer":
        return signal, [step.noise - dark.noise for step in steps]
    if kind == "linearity":
        at, deviation = deviations(dark, steps, found.saturation_photons)
        return at, 100 * deviation
    photons = [step.photons for step in steps]
    if kind == "sensitivity":
        return photons, signal
    ratio = zip(signal, steps, strict=True)
    return photons, [each / max(step.noise, 1e-300) ** 0.5 for each, step in ratio]


def _line(kind: str, found: Emva, own: Steps) -> tuple[Any, Any]:
    """Return the line of the figures in a picture."""
    if kind == "snr":
        grid = np.geomspace(found.threshold_photons, found.saturation_photons, 50)
        return grid, np.sqrt(found.efficiency * grid)
    if kind == "transfer":
        end = max(step.level for step in own[1]) - own[0].level
        return [0, end], [0, found.gain * end]
    end = found.saturation_photons
    return [0, end], [0, found.responsivity * end if kind == "sensitivity" else 0]
