"""The report's opening: what was seen, in words and numbers, and what came out."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from megalopta.config.model import Configuration, LightLevel
from megalopta.flow.metrics.curve import ErrorCurve
from megalopta.flow.metrics.photon_threshold import Threshold, format_flux
from megalopta.flow.metrics.response_error import Metric
from megalopta.plotting.text import (
    enumerate_words,
    level_name,
    level_title,
    number,
    plural,
)
from megalopta.report.budget import Budget, by_sensor
from megalopta.report.motion import MotionSection
from megalopta.report.verdicts import LIMIT
from megalopta.scenes.lighting.levels import illuminance_of

Thresholds = Mapping[str, Threshold]
NO_MOTION = "IM"
"""The yardstick among the methods: it measures brightness."""


class Fact(NamedTuple):
    """A number and what it counts."""

    value: str
    label: str


def title(configuration: Configuration) -> str:
    """Name of the sequence and the light it was seen in."""
    name = configuration.name.replace("_", " ").replace("-", " ")
    levels = sorted(configuration.light_levels, key=illuminance_of, reverse=True)
    return f"{name[0].upper()}{name[1:]}, {_span(levels)}"


def lead(configuration: Configuration, record: Mapping[str, Any]) -> str:
    """What the camera saw and what was done with it; `record` is that of the scene."""
    sensors = enumerate_words([sensor.name for sensor in configuration.sensors])
    levels = plural(len(configuration.light_levels), "light level")
    return (
        f"{configuration.scene.describe()} {_canopy(record)}The {configuration.camera} "
        f"{configuration.trajectory}. Every frame is "
        "rendered as spectral radiance, together with its exact motion. The light becomes "
        f"{_readings(configuration)} on {sensors} at {levels}, and motion detectors try to read "
        "the motion back."
    )


def _canopy(record: Mapping[str, Any]) -> str:
    """What was measured of the forest, if it is one."""
    return f"{record['canopy']} " if record.get("canopy") else ""


def facts(settings: Configuration, record: Mapping[str, Any], motion: MotionSection) -> list[Fact]:
    """Key numbers of the sequence; `record` is that of the scene."""
    camera, trajectory, seen = settings.camera, settings.trajectory, motion.objects_seen
    noted = {key: record[key] for key in ("objects", "triangles") if record.get(key)}
    return [
        Fact(f"{trajectory.frames}", f"frames of {camera.width} × {camera.height} px"),
        *(Fact(f"{count:,}", what) for what, count in settings.scene.counts.items()),
        *(Fact(f"{count:,}", what) for what, count in noted.items()),
        *_light_facts(record),
        *([Fact(f"{seen:,}", "objects in view, one time or another")] if seen else []),
        Fact(f"{motion.median_speed:.2g}", "px per frame, median speed"),
        Fact(f"{trajectory.frame_rate_hz:g}", "frames per second"),
    ]


def light_finding(budgets: Sequence[Budget]) -> str:
    """How much light there is, from the brightest to the darkest level."""
    ranked = by_sensor(sorted(budgets, key=lambda each: -each.illuminance_lux))
    sensor, own = next(iter(ranked.items()))
    bright, dark = own[0], own[-1]
    if bright.level == dark.level:
        ratios = [f"{_ratio(each[0])} on {name}" for name, each in ranked.items()]
        return (
            f"At {level_name(bright.level)}, {number(bright.photons)} photons per frame fall on a "
            f"pixel of {sensor}; a pixel's median signal-to-noise ratio is "
            f"{enumerate_words(ratios)}."
        )
    spans = [f"{_ratio(each[0])} to {_ratio(each[-1])} on {name}" for name, each in ranked.items()]
    # Beyond the visible, light of fewer lux may have more photons.
    falls = bright.photons > dark.photons
    return (
        f"From {level_name(bright.level)} to {level_name(dark.level)}, the photons on a pixel of "
        f"{sensor} {'fall' if falls else 'go'} from {number(bright.photons)} to "
        f"{number(dark.photons)} per frame, and a pixel's median signal-to-noise ratio goes from "
        f"{enumerate_words(spans)}."
    )


def _ratio(budget: Budget) -> str:
    return number(budget.signal_to_noise[1])


def dark_findings(budgets: Sequence[Budget]) -> list[str]:
    """At which light a sensor reads more dark counts or electrons than photons."""
    ranked = sorted(budgets, key=lambda each: -each.illuminance_lux)
    drowned = by_sensor([each for each in ranked if each.dark > each.detected])
    return [
        f"On {name}, dark {found[0].sensor.unit} outnumber the detected photons at "
        f"{enumerate_words([level_name(each.level) for each in found])} "
        f"({number(found[0].dark)} to {number(found[0].detected)} per pixel and frame"
        f"{f' at {level_name(found[0].level)}' if len(found) > 1 else ''})."
        for name, found in drowned.items()
    ]


def threshold_finding(curves: Sequence[ErrorCurve], metric: Metric) -> str | None:
    """Which detectors need the fewest photons, and which the most, at the largest size."""
    rows, columns = max(curve.shape for curve in curves)
    thresholds = {
        curve.method: threshold
        for curve in curves
        if (curve.shape, curve.metric) == ((rows, columns), metric)
        if curve.method != NO_MOTION and (threshold := curve.thresholds.get(2))
    }
    crossing = {name: threshold for name, threshold in thresholds.items() if threshold.flux}
    parts = [*_fewest(thresholds, crossing), *_most(thresholds, crossing)]
    if not parts:
        return None
    return (
        f"With perfect pixels and frames of {columns} × {rows} px, {', and '.join(parts)}, to "
        f"repeat the noise-free answer within {LIMIT} ({metric} error). Whether that answer is "
        "true, this does not say."
    )


def _fewest(thresholds: Thresholds, crossing: Thresholds) -> list[str]:
    below = [name for name, threshold in thresholds.items() if threshold.kind == "below"]
    if below:
        limit = format_flux(max(thresholds[name].range_min for name in below))
        return [f"{_named(below)} fewer than {limit} photons per frame"]
    if not crossing:
        return []
    least = min(crossing.values(), key=_flux)
    # Where intervals overlap, another draw might reverse the order.
    close = [
        name
        for name, threshold in crossing.items()
        if (threshold.low or 0) <= (least.high or math.inf)
    ]
    rank = " the fewest photons," if len(thresholds) > len(close) else ""
    fluxes = enumerate_words([format_flux(_flux(crossing[name])) for name in close])
    return [f"{_named(close)}{rank} {fluxes} per frame"]


def _most(thresholds: Thresholds, crossing: Thresholds) -> list[str]:
    above = [name for name, threshold in thresholds.items() if threshold.kind == "above"]
    if above:
        limit = format_flux(min(thresholds[name].range_max for name in above))
        return [f"{_named(above)} more than {limit} photons per frame"]
    if len(crossing) < 2:
        return []
    name, most = max(crossing.items(), key=lambda each: _flux(each[1]))
    others = [threshold for other, threshold in crossing.items() if other != name]
    if any((threshold.high or math.inf) >= (most.low or 0) for threshold in others):
        return []
    return [f"{name} needs the most, {format_flux(_flux(most))}"]


def _named(methods: Sequence[str]) -> str:
    return f"{enumerate_words(methods)} need{'s' if len(methods) == 1 else ''}"


def _flux(threshold: Threshold) -> float:
    return threshold.flux or math.nan


def _light_facts(record: Mapping[str, Any]) -> list[Fact]:
    """Illuminance as the renderer measured it at the light that was rendered."""
    light = record.get("illuminance")
    if not light:
        return []
    facts = [Fact(f"{light['unshaded_lux']:.3g} lux", "measured in the open, as rendered")]
    if light["ground"]:
        mean = sum(point["lux"] for point in light["ground"]) / len(light["ground"])
        facts.append(Fact(f"{mean:.2g} lux", "measured on the ground below the camera"))
    return facts


def _readings(configuration: Configuration) -> str:
    units = {"counts": "photon counts", "electrons": "electrons"}
    found = {sensor.unit for sensor in configuration.sensors}
    return " or ".join(words for unit, words in units.items() if unit in found)


def _span(levels: Sequence[LightLevel]) -> str:
    if len(levels) == 1:
        return f"at {level_title(levels[0])}"
    return f"from {level_name(levels[0])} to {level_name(levels[-1])}"
