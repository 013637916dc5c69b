"""The report's opening: what was seen, in words and numbers, and what came out."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from megalopta.configuration import Configuration, LightLevel
from megalopta.dataset import Dataset
from megalopta.flow.threshold import format_flux
from megalopta.report.budget import Budget
from megalopta.report.detectors import ACCURATE, DetectorSection, VerdictGroup
from megalopta.report.motion import MotionSection
from megalopta.report.needs import two_bit
from megalopta.report.text import (
    enumerate_words,
    level_name,
    level_title,
    number,
    percent,
    plural,
)
from megalopta.scenes.bench import Bench
from megalopta.scenes.build import SceneDescription
from megalopta.scenes.camera import Camera
from megalopta.scenes.forest import Forest
from megalopta.scenes.grating import Grating
from megalopta.scenes.light import illuminance_of
from megalopta.scenes.panorama import Panorama
from megalopta.scenes.plane import Plane

NO_MOTION = "IM"
"""The yardstick among the methods: it measures brightness."""

LIMIT = percent(ACCURATE)


@dataclass(frozen=True)
class Fact:
    """A number and what it counts."""

    value: str
    label: str


def title(configuration: Configuration) -> str:
    """Name of the sequence and the light it was seen in."""
    name = configuration.name.replace("_", " ").replace("-", " ")
    levels = sorted(configuration.light_levels, key=illuminance_of, reverse=True)
    return f"{name[0].upper()}{name[1:]}, {_span(levels)}"


def lead(configuration: Configuration) -> str:
    """What the camera saw and what was done with it."""
    sensors = enumerate_words([sensor.name for sensor in configuration.sensors])
    levels = plural(len(configuration.light_levels), "light level")
    return (
        f"{_scene(configuration.scene)} The {_camera(configuration.camera)} "
        f"{configuration.trajectory}. Every frame is "
        "rendered as spectral radiance, together with its exact motion. The light becomes "
        f"{_readings(configuration)} on {sensors} at {levels}, and motion detectors try to read "
        "the motion back."
    )


def facts(dataset: Dataset, motion: MotionSection) -> list[Fact]:
    """Key numbers of the sequence."""
    configuration = dataset.configuration
    camera, trajectory = configuration.camera, configuration.trajectory
    return [
        Fact(f"{trajectory.frames}", f"frames of {camera.width} × {camera.height} px"),
        *_scene_facts(configuration, dataset.read_scene_record()),
        *_seen_facts(motion.objects_seen),
        Fact(f"{motion.median_speed:.2g}", "px per frame, median speed"),
        Fact(f"{trajectory.frame_rate_hz:g}", "frames per second"),
    ]


def light_finding(budgets: Sequence[Budget]) -> str:
    """How much light there is, from the brightest to the darkest level."""
    ranked = sorted(budgets, key=lambda each: each.illuminance_lux)
    sensors = list(dict.fromkeys(each.sensor.name for each in budgets))
    if ranked[0].level == ranked[-1].level:
        ratios = [f"{number(each.signal_to_noise[1])} on {each.sensor.name}" for each in budgets]
        return (
            f"At {level_name(ranked[0].level)}, {number(budgets[0].photons)} photons per frame "
            f"fall on a pixel of {sensors[0]}; a pixel's median signal-to-noise ratio is "
            f"{enumerate_words(ratios)}."
        )
    spans = []
    for sensor in sensors:
        own = [each for each in ranked if each.sensor.name == sensor]
        ends = (f"{number(each.signal_to_noise[1])}" for each in (own[-1], own[0]))
        spans.append(f"{' to '.join(ends)} on {sensor}")
    first = [each for each in ranked if each.sensor.name == sensors[0]]
    return (
        f"From {level_name(first[-1].level)} to {level_name(first[0].level)}, the photons on a "
        f"pixel of {sensors[0]} fall from {number(first[-1].photons)} to "
        f"{number(first[0].photons)} per frame, and a pixel's median signal-to-noise ratio from "
        f"{enumerate_words(spans)}."
    )


def dark_findings(budgets: Sequence[Budget]) -> list[str]:
    """From which light on a sensor reads more dark counts or electrons than photons."""
    darkest_first = sorted(budgets, key=lambda each: each.illuminance_lux)
    brightest = {each.sensor.name: each for each in darkest_first if each.dark > each.detected}
    return [
        f"On {name}, dark {budget.sensor.unit} outnumber the detected photons at "
        f"{level_name(budget.level)} ({number(budget.dark)} to {number(budget.detected)} per pixel "
        "and frame) and below."
        for name, budget in brightest.items()
    ]


def motion_findings(section: DetectorSection) -> list[str]:
    """How many detectors read motion, per sensor and light level."""
    return [_motion_finding(group) for group in section.verdicts if group.rows.keys() - {NO_MOTION}]


def _motion_finding(group: VerdictGroup) -> str:
    rows = [row for method, row in group.rows.items() if method != NO_MOTION]
    counts = [sum(row[index].kind == "both" for row in rows) for index in range(len(group.levels))]
    if not any(counts):
        return (
            f"On {group.sensor}, no motion detector stays within {LIMIT} of its noise-free answer "
            "at any light level."
        )
    parts = [
        f"{count or 'none'} at {level}" for count, level in zip(counts, group.levels, strict=True)
    ]
    return (
        f"On {group.sensor}, of {plural(len(rows), 'motion detector')} these stay within {LIMIT} "
        f"of their noise-free answer: {', '.join(parts)}."
    )


def need_finding(benchmark: Mapping[str, Any]) -> str | None:
    """Which detector needs the fewest photons, and which the most, at the largest size."""
    metric = benchmark["settings"]["metrics"][0]
    rows, columns = max(curve["shape"] for curve in benchmark["curves"])
    needs = {
        curve["method"]: need.flux
        for curve in benchmark["curves"]
        if (curve["shape"], curve["metric"]) == ([rows, columns], metric)
        if curve["method"] != NO_MOTION and (need := two_bit(curve)) and need.flux
    }
    if not needs:
        return None
    least, most = min(needs, key=needs.__getitem__), max(needs, key=needs.__getitem__)
    return (
        f"With perfect pixels and frames of {columns} × {rows} px, {least} needs the fewest "
        f"photons to stay within {LIMIT} ({metric} error), {format_flux(needs[least])} per frame, "
        f"and {most} the most, {format_flux(needs[most])}."
    )


def _scene_facts(configuration: Configuration, record: Mapping[str, Any]) -> list[Fact]:
    scene = configuration.scene
    trees = [Fact(f"{scene.trees:,}", "trees")] if isinstance(scene, Forest) else []
    counted = [Fact(f"{record[key]:,}", key) for key in ("objects", "triangles") if record.get(key)]
    return trees + counted + _light_facts(record)


def _seen_facts(objects: int) -> list[Fact]:
    return [Fact(f"{objects:,}", "objects in view, one time or another")] if objects else []


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


def _scene(scene: SceneDescription) -> str:
    if isinstance(scene, Panorama):
        return f"A photographed panorama, {Path(scene.file.path).name}."
    if isinstance(scene, Grating):
        return (
            f"{_PATTERNS[scene.pattern]} of contrast {scene.contrast:g}, "
            f"{scene.cycles_per_frame:g} cycles across the frame, on a cylinder around the camera."
        )
    if isinstance(scene, Plane):
        return (
            f"{_PATTERNS[scene.pattern]} of contrast {scene.contrast:g} and period "
            f"{scene.period_m:g} m on a board, {scene.distance_m:g} m from the camera at first."
        )
    if isinstance(scene, Bench):
        return (
            f"A plate, {scene.plate_mm:g} mm wide, that lets {scene.shade:.0%} of the light "
            f"through, over pixels {scene.pixel_pitch_um:g} µm apart."
        )
    species = enumerate_words([name for name, share in scene.mix.items() if share > 0])
    return f"A forest of {scene.trees:,} trees ({species}), {scene.density_per_ha:g} per hectare."


_PATTERNS = {
    "sine_2d": "A 2-D sine grating",
    "sine": "A sine grating",
    "square": "A square-wave grating",
    "dots": "Random dots",
}


def _camera(camera: Camera) -> str:
    return "camera" if camera.kind == "perspective" else f"{camera.kind} camera"
