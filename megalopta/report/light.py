"""Section "From light to counts": the photon budget and the counts as pictures."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from megalopta.plotting.text import (
    UNDEFINED,
    enumerate_words,
    level_name,
    level_title,
    number,
    percent,
    short,
)
from megalopta.report.budget import Budget, ExposureSummary
from megalopta.report.charts import signal_chart
from megalopta.report.components import RADIANCE_FILM, Picture, Table, film
from megalopta.report.footage import ReportFrames
from megalopta.report.images import gray_scale
from megalopta.sensor import CtiaSensor, ImageSensor
from megalopta.sensor.counters.digital import LARGEST_CAPACITY
from megalopta.sensor.spad.order import active_effects

_RECOVERY = {
    "ideal": "no dead time",
    "nonparalyzable": "dead time {} (non-paralyzable)",
    "paralyzable": "dead time {} (paralyzable)",
}
_BIAS = {
    "fixed": "the bias of its diodes is not trimmed",
    "dac": "a converter sets the bias of each diode (non-adaptive)",
    "floating_gate": "a floating gate trims the bias of each diode (adaptive)",
}

# As the preview of the radiance: the brightest tenth may be shown as pure white.
_WHITE_PERCENTILE = 90.0


@dataclass(frozen=True)
class SensorPanel:
    """What one sensor made of the light."""

    name: str
    description: str
    effects: tuple[tuple[str, str], ...]
    """Name and statement of each that is on, in the order in which they act."""
    pictures: tuple[Picture, ...]
    budget: Table
    saturation: str
    rendering: str


@dataclass(frozen=True)
class LightSection:
    """Panels and chart."""

    panels: tuple[SensorPanel, ...]
    chart: Markup


def light_section(
    sensors: Sequence[ImageSensor], footage: ReportFrames, shown: Sequence[ExposureSummary]
) -> LightSection:
    """Section of these sensors at all light levels."""
    panels = tuple(
        _panel(sensor, footage, [each for each in shown if each.budget.sensor.name == sensor.name])
        for sensor in sensors
    )
    names = [sensor.name for sensor in sensors]
    return LightSection(panels, signal_chart([each.budget for each in shown], names))


def describe(sensor: ImageSensor) -> str:
    """A sensor in one sentence, from its parameters."""
    return (
        f"Pixels of {1e6 * sensor.pitch_m:.3g} µm, {percent(sensor.fill_factor)} of their area "
        f"sensitive; {_detection(sensor)}; {_time(sensor.exposure_s)} exposure; "
        f"{_readout(sensor)}."
    )


def _detection(sensor: ImageSensor) -> str:
    curve = sensor.efficiency
    best = int(np.argmax(curve.values))
    most, where = "at most ", f", at {curve.wavelengths_nm[best]:g} nm"
    if len(set(curve.values)) == 1:
        most = where = ""
    return f"it detects {most}{percent(curve.values[best])} of the photons on it{where}"


def _readout(sensor: ImageSensor) -> str:
    if isinstance(sensor, CtiaSensor):
        farad = f"{1e12 * sensor.capacitance_f:g} pF"
        return f"it integrates on {farad}, {sensor.swing_v:g} V at most; {_BIAS[sensor.bias.kind]}"
    recovery = _RECOVERY[sensor.dead_time.kind].format(_time(sensor.dead_time.dead_time_s))
    if sensor.counter_capacity == LARGEST_CAPACITY:
        return recovery
    return f"{recovery}; a counter holds {sensor.counter_capacity:,}"


def _effects(sensor: ImageSensor) -> tuple[tuple[str, str], ...]:
    """Name of each effect that is on, in order, and what it does."""
    if isinstance(sensor, CtiaSensor):
        return ()
    names = active_effects(sensor)
    return tuple((name.replace("_", " "), getattr(sensor, name).statement) for name in names)


def _time(seconds: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= 0.999 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{1e9 * seconds:.3g} ns"


def _panel(
    sensor: ImageSensor, footage: ReportFrames, shown: Sequence[ExposureSummary]
) -> SensorPanel:
    frames, budgets = len(footage.selection.frames), [each.budget for each in shown]
    radiance = Picture(RADIANCE_FILM, "The scene's light, tone-mapped", "radiance", frames)
    return SensorPanel(
        sensor.name,
        describe(sensor),
        _effects(sensor),
        (radiance, *(_counts_film(each) for each in shown)),
        _budget_table(sensor, budgets),
        _saturation(sensor, budgets),
        _rendering(budgets),
    )


def _budget_table(sensor: ImageSensor, budgets: Sequence[Budget]) -> Table:
    columns = {
        "Light": [level_title(each.level) for each in budgets],
        "Photons on the pixel": [number(each.photons) for each in budgets],
        "Detected": [number(each.detected) for each in budgets],
        f"Dark {sensor.unit}": [number(each.dark) for each in budgets],
        f"Expected {sensor.unit}": [number(each.expected) for each in budgets],
        "Signal-to-noise": [number(each.signal_to_noise[1]) for each in budgets],
        "Saturated": [percent(each.saturated_fraction) for each in budgets],
    }
    noises = [each.rendering_noise for each in budgets]
    if any(noise is not None for noise in noises):
        columns["Rendering : shot noise"] = [
            UNDEFINED if noise is None else number(noise) for noise in noises
        ]
    rows = tuple(zip(*columns.values(), strict=True))
    return Table(f"Photon budget of {sensor.name}", tuple(columns), rows)


def _counts_film(exposed: ExposureSummary) -> Picture:
    level, sensor = exposed.budget.level, exposed.budget.sensor
    counts, full = exposed.counts.astype(np.float64), exposed.saturated
    white = max(math.ceil(np.percentile(counts, _WHITE_PERCENTILE)), 1)
    scale = gray_scale(white)
    legend = scale.legend("0", f"≥ {short(white)} {sensor.unit}", "full" if full.any() else "")
    name = level_name(level)
    alt = f"{sensor.unit.capitalize()} of {sensor.name} at {name}"
    return film([*map(scale.picture, counts, full)], name, alt, legend)


def _rendering(budgets: Sequence[Budget]) -> str:
    """Where the rendering, not the photons, sets how clean a frame is."""
    noisy = [level_name(each.level) for each in budgets if (each.rendering_noise or 0) > 1]
    if not noisy:
        return ""
    return (
        f"At {enumerate_words(noisy)} the rendering is noisier than the photons: these frames are "
        "less clean than such light would make them."
    )


def _saturation(sensor: ImageSensor, budgets: Sequence[Budget]) -> str:
    shares = [
        f"{percent(each.saturated_fraction)} at {level_name(each.level)}"
        for each in budgets
        if each.saturated_fraction > 0
    ]
    if not shares:
        return ""
    full = (
        f"Full pixels ({sensor.swing_v:g} V)"
        if isinstance(sensor, CtiaSensor)
        else f"Full counters ({sensor.counter_capacity:,} counts)"
    )
    return (
        f"{full}: {enumerate_words(shares)} of all readings. They are lower bounds, orange in the "
        "pictures."
    )
