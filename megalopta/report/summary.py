"""The report's opening: what was seen, in words and numbers, and a table of what came out."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from megalopta.config.model import Configuration, LightLevel
from megalopta.dataset.flow_record import FlowRecord
from megalopta.plotting.text import UNDEFINED, level_name, level_title, number, percent, plural
from megalopta.report.budget import Budget, by_sensor
from megalopta.report.error_tables import ACCURATE
from megalopta.report.records import Record
from megalopta.report.source import Report
from megalopta.scenes.lighting.levels import illuminance_of

OUTCOME = (
    "sensor",
    "best method",
    "within 25 % down to",
    "median error there",
    "photons on a pixel",
    "signal-to-noise",
    "more dark readings than light at",
)
"""Heads of the table of what came out; spans go from the brightest light to the darkest."""


def title(configuration: Configuration) -> str:
    """Return the name of the sequence and the light it was seen in."""
    name = configuration.name.replace("_", " ").replace("-", " ")
    levels = sorted(configuration.light_levels, key=illuminance_of, reverse=True)
    light = f"at {level_title(levels[0])}"
    if len(levels) > 1:
        light = f"from {level_name(levels[0])} to {level_name(levels[-1])}"
    return f"{name[0].upper()}{name[1:]}, {light}"


def lead(configuration: Configuration, record: Record) -> str:
    """Return what the camera saw and what was done with it; `record` is that of the scene."""
    sensors = ", ".join(sensor.name for sensor in configuration.sensors)
    canopy = f"{record['canopy']} " if record.get("canopy") else ""
    return (
        f"{configuration.scene.describe()} {canopy}The {configuration.camera} "
        f"{configuration.trajectory}. Every frame is rendered as spectral radiance, together with "
        f"its exact motion. The light becomes readings of {sensors} at "
        f"{plural(len(configuration.light_levels), 'light level')}, and motion detectors try to "
        "read the motion back."
    )


def facts(report: Report) -> Iterator[tuple[str, str]]:
    """Yield what is counted, and how many there are."""
    camera, trajectory = report.settings.camera, report.settings.trajectory
    yield f"frames of {camera.width} × {camera.height} px", f"{trajectory.frames}"
    for what, count in report.settings.scene.counts.items():
        yield what, f"{count:,}"
    for what in ("objects", "triangles"):
        if noted := report.scene.get(what):
            yield what, f"{noted:,}"
    if light := report.scene.get("illuminance"):
        yield "measured in the open, as rendered", f"{light['unshaded_lux']:.3g} lux"
        if ground := [point["lux"] for point in light["ground"]]:
            mean = sum(ground) / len(ground)
            yield "measured on the ground below the camera", f"{mean:.2g} lux"
    yield "objects in view, one time or another", f"{report.objects_seen:,}"
    yield "px per frame, median speed", f"{report.median_speed:.2g}"
    yield "frames per second", f"{trajectory.frame_rate_hz:g}"


def outcome(records: Sequence[FlowRecord], budgets: Sequence[Budget]) -> list[tuple[str, ...]]:
    """Return rows below `OUTCOME`, one for each sensor."""
    ranked = by_sensor(sorted(budgets, key=lambda each: -each.illuminance_lux))
    names = dict.fromkeys([*ranked, *(each.sensor for each in records)])
    return [(name, *_reach(records, name), *_light(ranked.get(name, []))) for name in names]


def _light(own: Sequence[Budget]) -> tuple[str, str, str]:
    if not own:
        return UNDEFINED, UNDEFINED, UNDEFINED
    ends = own[:1] if len(own) == 1 else (own[0], own[-1])
    drowned = [level_name(each.level) for each in own if each.dark > each.detected]
    return (
        " → ".join(number(each.photons) for each in ends),
        " → ".join(number(each.signal_to_noise[1]) for each in ends),
        ", ".join(drowned) or UNDEFINED,
    )


class _Answer(NamedTuple):
    """Median error over blocks of one method at one light level, relative to the true velocity."""

    method: str
    level: LightLevel
    error: float

    @property
    def lux(self) -> float:
        return illuminance_of(self.level)


def _reach(records: Sequence[FlowRecord], sensor: str) -> tuple[str, str, str]:
    """Return the method that stays accurate down to the least light, the light, and its error."""
    answers = list(_answers(records, sensor))
    if not answers:
        return UNDEFINED, UNDEFINED, UNDEFINED
    last = [found for name in {each.method for each in answers} if (found := _last(answers, name))]
    if not last:
        nearest = min(answers, key=lambda each: (each.error, -each.lux))
        return nearest.method, "none", f"{percent(nearest.error)} at {level_name(nearest.level)}"
    best = min(last, key=lambda each: (each.lux, each.error))
    return best.method, level_name(best.level), percent(best.error)


def _answers(records: Sequence[FlowRecord], sensor: str) -> Iterator[_Answer]:
    """Yield what is known of a sensor; corrected readings count as a method of their own."""
    for each in records:
        if each.sensor == sensor and each.truth:
            forms = {each.method: each.truth.counts}
            if each.truth.corrected:
                forms[f"{each.method}, corrected"] = each.truth.corrected
            for name, errors in forms.items():
                if errors.relative_error_median is not None:
                    yield _Answer(name, each.level, errors.relative_error_median)


def _last(answers: Sequence[_Answer], method: str) -> _Answer | None:
    """Return the darkest level down to which a method is accurate, from the first one that it is.

    Brighter levels at which it is not, as where counters are full, are passed over.
    """
    own = sorted((each for each in answers if each.method == method), key=lambda each: -each.lux)
    last = None
    for each in own:
        if each.error < ACCURATE:
            last = each
        elif last:
            break
    return last
