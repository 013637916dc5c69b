"""Section "From light to counts": sensors, photon budget, and counts as pictures."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import cycle

import numpy as np
from markupsafe import Markup

from megalopta.config.model import Configuration
from megalopta.plotting.sections import (
    Section,
    block,
    card,
    definitions,
    folded,
    heading,
    paragraph,
    table,
)
from megalopta.plotting.style import BLACK, DASHES, MARKERS
from megalopta.plotting.svg import (
    CHART_PT,
    NUMBERS,
    drawable,
    in_style,
    logarithmic,
    new_axes,
    to_svg,
    verbatim,
)
from megalopta.plotting.text import level_title, number, percent
from megalopta.report.images import film
from megalopta.report.source import Budget, Report, absent, by_sensor
from megalopta.sensor import CtiaSensor, ImageSensor
from megalopta.sensor.spad.counters import LARGEST_CAPACITY
from megalopta.sensor.spad.model import active_effects

_GUIDE = (
    "In one exposure per frame, a pixel counts single photons or integrates their electrons. A "
    "reading with mean N scatters by about √N; an integrating pixel adds dark current, reset and "
    "read noise. Each sensor is exposed to the same light, scaled to each level; a named level has "
    "its own spectrum. The pictures show single frames, with the scale below each. Orange pixels "
    "are saturated: their readings are lower bounds. "
)
_INSTANT = (
    "Every frame is rendered at one instant: camera motion during the exposure does not blur the "
    "picture."
)
_PICTURE = (
    "The light of a picture is constant during an exposure, unless sub_frames says otherwise; blur "
    "and noise of the picture are part of the light."
)
_COLUMNS = Markup(
    "Means over pixels and frames, per pixel and exposure. <b>Photons on the pixel</b>: on its "
    "whole area. <b>Detected</b>: photons that reach the sensitive area and release a pulse or an "
    "electron. <b>Dark</b>: readings without light. <b>Expected</b>: noise-free mean of both after "
    "dead time. <b>Signal-to-noise</b> (median over pixels): the light's contribution to a reading "
    "over the reading's standard deviation. <b>Saturated</b>: readings at a counter's capacity or "
    "the pixel's full swing. <b>Rendering : shot noise</b>: ratio of standard deviations; above 1, "
    "the rendering is noisier than the photons."
)
_CHART = (
    "Median over pixels; the shaded band holds the middle 90 %. Ten times the light gains a factor "
    "of √10 where photon noise dominates, and a factor of 10 where dark readings dominate. Below "
    "1, motion can only be read from many pixels or frames."
)
_BIASES = {"fixed": "fixed", "dac": "converter (non-adaptive)", "floating_gate": "floating gate"}


def light_section(report: Report) -> Section:
    """Return the section; without counts, the command to run."""
    title = f"From light to {' and '.join(report.units)}"
    section = Section(title, name="light", link=f"Light to {report.units[0]}")
    shown, sensors = report.exposures, report.settings.sensors
    if not shown:
        missing = absent(report, "sense", "No sensor has been exposed yet.")
        return replace(section, body=missing)
    chart = signal_chart(shown, [sensor.name for sensor in sensors])
    body = Markup("\n").join(
        [
            *(_card(report, sensor) for sensor in sensors),
            paragraph(_COLUMNS, "note"),
            block(
                "card pair",
                block("", heading("Signal and noise of a single pixel"), paragraph(_CHART)),
                chart,
            ),
        ]
    )
    return replace(section, text=_GUIDE + _shutter(report.settings), body=body)


def _shutter(settings: Configuration) -> str:
    shutter = settings.shutter
    if not settings.scene.has_truth:
        return _PICTURE
    if shutter.is_instant:
        return _INSTANT
    line = ("column", "row")[shutter.across]
    return (
        f"Frames and true motion are those of the shutter, blurred by the motion during "
        f"{shutter.exposure_s or 0:g} s and read out {line} by {line} from the "
        f"{shutter.readout_from} within {shutter.readout_s or 0:g} s."
    )


def _card(report: Report, sensor: ImageSensor) -> Markup:
    shown = by_sensor(report.exposures)[sensor.name]
    films = (counts_film(report, each) for each in shown)
    about = " · ".join(f"{name} {value}" for name, value in properties(sensor))
    return card(
        sensor.name,
        paragraph(f"{about}.", "note"),
        _effects(sensor),
        block("strip", film(None, "radiance", "The scene's light, tone-mapped"), *films),
        table(f"Photon budget of {sensor.name}", *budget_table(sensor, shown)),
    )


def properties(sensor: ImageSensor) -> Iterator[tuple[str, str]]:
    """Yield properties of a sensor by name: pixel, efficiency, exposure, and readout."""
    curve = sensor.efficiency
    best = int(np.argmax(curve.values))
    yield "pixels of", f"{1e6 * sensor.pitch_m:.3g} µm"
    yield "fill factor", percent(sensor.fill_factor)
    where = f" at {curve.wavelengths_nm[best]:g} nm" if len(set(curve.values)) > 1 else ""
    yield "efficiency", f"{percent(curve.values[best])}{where}"
    yield "exposure", _time(sensor.exposure_s)
    if isinstance(sensor, CtiaSensor):
        yield "capacitance", f"{1e12 * sensor.capacitance_f:g} pF"
        yield "swing", f"{sensor.swing_v:g} V"
        yield "bias of the diodes", _BIASES[sensor.bias.kind]
    else:
        dead = sensor.dead_time
        yield "dead time", f"{_time(dead.dead_time_s)} ({dead.kind})"
        if sensor.counter_capacity < LARGEST_CAPACITY:
            yield "counter up to", f"{sensor.counter_capacity:,}"


def _time(seconds: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= 0.999 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{1e9 * seconds:.3g} ns"


def _effects(sensor: ImageSensor) -> Markup:
    """Return the name and description of each active effect, in order."""
    if isinstance(sensor, CtiaSensor):
        return Markup("")
    names = active_effects(sensor)
    statements = [(each.replace("_", " "), getattr(sensor, each).statement) for each in names]
    summary = ", ".join(name for name, _ in statements)
    return folded(f"Modeled, in this order: {summary}", definitions("effects", statements))


def budget_table(
    sensor: ImageSensor, budgets: Sequence[Budget]
) -> tuple[list[str], list[tuple[str, ...]]]:
    """Return head and rows of the photon budget, a row per light level."""
    columns = {
        "Light": [level_title(each.level) for each in budgets],
        "Photons on the pixel": [number(each.photons) for each in budgets],
        "Detected": [number(each.detected) for each in budgets],
        f"Dark {sensor.unit}": [number(each.dark) for each in budgets],
        f"Expected {sensor.unit}": [number(each.expected) for each in budgets],
        "Signal-to-noise": [number(each.signal_to_noise[1]) for each in budgets],
        "Saturated": [percent(each.saturated_fraction) for each in budgets],
        "Rendering : shot noise": [number(each.rendering_noise) for each in budgets],
    }
    return list(columns), list(zip(*columns.values(), strict=True))


def counts_film(report: Report, exposure: Budget) -> Markup:
    """Return the readings of an exposure as a film, with their scale."""
    panel = report.shown.readings(exposure.sensor, exposure.level)
    return report.shown.film(panel, panel.level)


@in_style
def signal_chart(budgets: Sequence[Budget], sensors: Sequence[str]) -> Markup:
    """Draw the signal-to-noise ratio of a pixel over illuminance, a line per sensor."""
    figure, axes = new_axes(*CHART_PT)
    # Before drawing: with no value above zero, the axes keep their first limits.
    logarithmic(axes, "x", NUMBERS)
    logarithmic(axes, "y", NUMBERS)
    ranked = by_sensor(sorted(budgets, key=lambda each: each.illuminance_lux))
    for sensor, marker, dash in zip(sensors, cycle(MARKERS), cycle(DASHES), strict=False):
        own = ranked[sensor]
        lux = [each.illuminance_lux for each in own]
        low, median, high = drawable(np.array([each.signal_to_noise for each in own])).T
        axes.plot(lux, median, marker, linestyle=dash, color=BLACK, label=verbatim(sensor))
        axes.fill_between(lux, low, high, color=BLACK, alpha=0.12, linewidth=0)
    axes.axhline(1, color=BLACK, linewidth=1, linestyle=":", label="signal = noise")
    axes.set(xlabel="illuminance (lux)", ylabel="signal-to-noise ratio of a pixel")
    axes.legend(loc="lower right", frameon=False)
    return to_svg(figure, "signal", "Signal-to-noise ratio of a pixel over illuminance")
