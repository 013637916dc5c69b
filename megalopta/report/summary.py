"""The report's opening: what was seen, in words and numbers, and what came out."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
from megalopta.scenes.forest import Forest
from megalopta.scenes.grating import Grating
from megalopta.scenes.light import illuminance_of
from megalopta.scenes.plane import Plane
from megalopta.scenes.trajectory import Trajectory

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
        f"{_scene(configuration.scene)} {_camera(configuration.trajectory)} Every frame is "
        "rendered as spectral radiance, together with its exact motion. The light becomes photon "
        f"counts on {sensors} at {levels}, and motion detectors try to read the motion back."
    )


def facts(dataset: Dataset, motion: MotionSection) -> list[Fact]:
    """Key numbers of the sequence."""
    configuration = dataset.configuration
    camera, trajectory = configuration.camera, configuration.trajectory
    return [
        Fact(f"{trajectory.frames}", f"frames of {camera.width} × {camera.height} px"),
        *_scene_facts(configuration, scene_record(dataset)),
        Fact(f"{motion.objects_seen:,}", "objects in view, one time or another"),
        Fact(f"{motion.median_speed:.2g}", "px per frame, median speed"),
        Fact(f"{trajectory.frame_rate_hz:g}", "frames per second"),
    ]


def light_finding(budgets: Sequence[Budget]) -> str:
    """How much light there is, from the brightest to the darkest level."""
    ranked = sorted(budgets, key=lambda each: each.illuminance_lux)
    sensors = list(dict.fromkeys(each.sensor.name for each in budgets))
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
    """From which light on a sensor counts more dark counts than photons."""
    darkest_first = sorted(budgets, key=lambda each: each.illuminance_lux)
    brightest = {
        each.sensor.name: each for each in darkest_first if each.dark_counts > each.detected
    }
    return [
        f"On {name}, dark counts outnumber the detected photons at {level_name(budget.level)} "
        f"({number(budget.dark_counts)} to {number(budget.detected)} per pixel and frame) and "
        "below."
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


def scene_record(dataset: Dataset) -> Mapping[str, Any]:
    """What the render stage noted about the scene and the renderer; empty when it did not."""
    try:
        return dict(json.loads(dataset.scene_record.read_text("utf-8")))
    except (OSError, ValueError):
        return {}


def _scene_facts(configuration: Configuration, record: Mapping[str, Any]) -> list[Fact]:
    scene = configuration.scene
    trees = [Fact(f"{scene.trees:,}", "trees")] if isinstance(scene, Forest) else []
    counted = [Fact(f"{record[key]:,}", key) for key in ("objects", "triangles") if key in record]
    return trees + counted


def _span(levels: Sequence[LightLevel]) -> str:
    if len(levels) == 1:
        return f"at {level_title(levels[0])}"
    return f"from {level_name(levels[0])} to {level_name(levels[-1])}"


def _scene(scene: SceneDescription) -> str:
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


def _camera(trajectory: Trajectory) -> str:
    speed, turn = math.hypot(*trajectory.velocity_m_s), trajectory.rotation_deg_s
    side = "left" if turn > 0 else "right"
    turning = f"turns {side} by {abs(turn):g}° per second" if turn else ""
    moving = f"moves at {speed:.3g} m per second" if speed else ""
    motion = " and ".join(part for part in (turning, moving) if part) or "stands still"
    return f"The camera {motion}."
