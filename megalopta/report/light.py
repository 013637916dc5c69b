"""Section "From light to counts": the photon budget and the counts as pictures."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from megalopta.report.budget import Budget, ExposureSummary
from megalopta.report.charts import signal_chart
from megalopta.report.components import RADIANCE_FILM, Picture, Table, film
from megalopta.report.footage import ReportFrames
from megalopta.report.images import gray_scale
from megalopta.report.text import (
    UNDEFINED,
    enumerate_words,
    level_name,
    level_title,
    number,
    percent,
    short,
)
from megalopta.sensor import CtiaSensor, ImageSensor
from megalopta.sensor.counters import LARGEST_CAPACITY
from megalopta.sensor.spad import active_effects

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
        f"{_readout(sensor)}.{_effects(sensor)}"
    )


def _detection(sensor: ImageSensor) -> str:
    best = int(np.argmax(sensor.efficiency.values))
    efficiency, peak_nm = sensor.efficiency.values[best], sensor.efficiency.wavelengths_nm[best]
    flat = len(set(sensor.efficiency.values)) == 1
    if flat:
        return f"it detects {percent(efficiency)} of the photons on it"
    return f"it detects at most {percent(efficiency)} of the photons on it, at {peak_nm:g} nm"


def _readout(sensor: ImageSensor) -> str:
    if isinstance(sensor, CtiaSensor):
        farad = f"{1e12 * sensor.capacitance_f:g} pF"
        return f"it integrates on {farad}, {sensor.swing_v:g} V at most; {_BIAS[sensor.bias.kind]}"
    recovery = _RECOVERY[sensor.dead_time.kind].format(_time(sensor.dead_time.dead_time_s))
    if sensor.counter_capacity == LARGEST_CAPACITY:
        return recovery
    return f"{recovery}; a counter holds {sensor.counter_capacity:,}"


def _effects(sensor: ImageSensor) -> str:
    if isinstance(sensor, CtiaSensor):
        return ""
    names = [field.replace("_", " ") for field in active_effects(sensor)]
    return f" Modeled, in this order: {enumerate_words(names)}."


def _time(seconds: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= 0.999 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{1e9 * seconds:.3g} ns"


def _panel(
    sensor: ImageSensor, footage: ReportFrames, shown: Sequence[ExposureSummary]
) -> SensorPanel:
    radiance = Picture(
        RADIANCE_FILM, "The scene's light, tone-mapped", "radiance", len(footage.selection.frames)
    )
    return SensorPanel(
        sensor.name,
        describe(sensor),
        (radiance, *(_counts_film(each) for each in shown)),
        _budget_table(sensor, [each.budget for each in shown]),
        _saturation(sensor, [each.budget for each in shown]),
        _rendering([each.budget for each in shown]),
    )


def _budget_table(sensor: ImageSensor, budgets: Sequence[Budget]) -> Table:
    columns, rows = _columns(sensor), [_budget_row(each) for each in budgets]
    if any(each.rendering_noise is not None for each in budgets):
        columns += ("Rendering : shot noise",)
        rows = [
            (*row, UNDEFINED if each.rendering_noise is None else number(each.rendering_noise))
            for row, each in zip(rows, budgets, strict=True)
        ]
    return Table(f"Photon budget of {sensor.name}", columns, tuple(rows))


def _columns(sensor: ImageSensor) -> tuple[str, ...]:
    return (
        "Light",
        "Photons on the pixel",
        "Detected",
        f"Dark {sensor.unit}",
        f"Expected {sensor.unit}",
        "Signal-to-noise",
        "Saturated",
    )


def _counts_film(exposed: ExposureSummary) -> Picture:
    budget, counts = exposed.budget, exposed.counts.astype(np.float64)
    white = max(math.ceil(np.percentile(counts, _WHITE_PERCENTILE)), 1)
    scale = gray_scale(white)
    images = [
        scale.picture(frame, full) for frame, full in zip(counts, exposed.saturated, strict=True)
    ]
    legend = scale.legend(
        "0", f"≥ {short(white)} {budget.sensor.unit}", "full" if exposed.saturated.any() else ""
    )
    name = level_name(budget.level)
    unit = budget.sensor.unit.capitalize()
    return film(images, name, f"{unit} of {budget.sensor.name} at {name}", legend)


def _budget_row(budget: Budget) -> tuple[str, ...]:
    return (
        level_title(budget.level),
        number(budget.photons),
        number(budget.detected),
        number(budget.dark),
        number(budget.expected),
        number(budget.signal_to_noise[1]),
        percent(budget.saturated_fraction),
    )


def _rendering(budgets: Sequence[Budget]) -> str:
    """Where the rendering, not the photons, sets how clean a frame is."""
    noisy = [
        level_name(each.level)
        for each in budgets
        if each.rendering_noise is not None and each.rendering_noise > 1
    ]
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
