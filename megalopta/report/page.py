"""The report: its opening with setup and results, and its sections in order."""

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import chain, dropwhile, takewhile
from pathlib import Path
from typing import NamedTuple

from markupsafe import Markup

from megalopta.benchmark.ranking_page import ATLAS, atlas, best_methods, order_changes
from megalopta.benchmark.ranking_run import FOLDER, read_ranking
from megalopta.config.model import Configuration, LightLevel
from megalopta.config.yaml_model import to_yaml
from megalopta.core.files import write_text
from megalopta.dataset.flow_record import FlowRecord
from megalopta.dataset.store import Dataset
from megalopta.plotting.sections import (
    Section,
    block,
    card,
    definitions,
    folded,
    page_of,
    paragraph,
    table,
)
from megalopta.plotting.text import (
    UNDEFINED,
    level_name,
    level_title,
    number,
    percent,
    time_text,
    title,
)
from megalopta.report.detectors import ACCURATE, detector_section
from megalopta.report.images import film, with_ends
from megalopta.report.light_section import counts_film, light_section
from megalopta.report.motion_section import flow_film, motion_section
from megalopta.report.source import (
    Budget,
    Record,
    Report,
    by_sensor,
    rendering,
    rendering_errors,
)
from megalopta.report.thresholds import threshold_section
from megalopta.scenes import Light, Pictures
from megalopta.scenes.levels import illuminance_of
from megalopta.stages import versions

OUTCOME = (
    "sensor",
    "best method",
    "within 25 % down to",
    "median error there",
    "photons per pixel",
    "signal-to-noise",
    "dark readings dominate at",
)
"""Heads of the table of results; ranges go from the brightest light to the darkest."""


def lead(configuration: Configuration, record: Record) -> str:
    """Return a paragraph on scene, camera and sensors; `record` is that of the scene."""
    levels = configuration.light_levels
    *others, last = (sensor.name for sensor in configuration.sensors)
    sensors = f"{', '.join(others)} and {last}" if others else last
    scene, light = configuration.scene, configuration.light
    about = (
        _assumed(scene, light, record)
        if isinstance(scene, Pictures)
        else f"The {configuration.camera} {configuration.trajectory}. Every frame is "
        "rendered as spectral radiance, together with its exact motion. "
    )
    return (
        f"{scene.describe()} {about}"
        f"The light becomes readings of {sensors} at "
        f"{len(levels)} light level{'s'[: len(levels) != 1]}, from which motion detectors estimate "
        "the motion."
    )


def _assumed(scene: Pictures, light: Light, record: Record) -> str:
    """Return the assumptions about pictures, and their limits."""
    found = record["pictures"]
    return (
        f"{found['transfer']} codes are converted to light; white has the spectrum of "
        f"{scene.white_name(light)}, and the mean reflectance is {percent(scene.reflectance)}. "
        f"{percent(found['saturated'])} of the pixels are saturated in the file. "
    )


def facts(report: Report) -> Iterator[tuple[str, str]]:
    """Yield facts: names and numbers."""
    camera, trajectory = report.settings.camera, report.settings.trajectory
    yield f"frames of {camera.width} × {camera.height} px", f"{trajectory.frames}"
    for what, count in report.settings.scene.counts.items():
        yield what, f"{count:,}"
    for what in ("objects", "triangles"):
        if noted := report.scene.get(what):
            yield what, f"{noted:,}"
    if light := report.scene.get("illuminance"):
        yield "illuminance in the open, as rendered", f"{light['unshaded_lux']:.3g} lux"
        if ground := [point["lux"] for point in light["ground"]]:
            mean = sum(ground) / len(ground)
            yield "illuminance on the ground below the camera", f"{mean:.2g} lux"
    if report.has_truth:
        yield "objects in view at any time", f"{report.objects_seen:,}"
    if report.shown.motions:
        yield "px per frame, median speed", f"{report.median_speed:.2g}"
    yield "frames per second", f"{trajectory.frame_rate_hz:g}"


def outcome(records: Sequence[FlowRecord], budgets: Sequence[Budget]) -> list[tuple[str, ...]]:
    """Return rows below `OUTCOME`, one per sensor."""
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
    """Error of one method at one light level, against the true velocity."""

    method: str
    """Name, with ", corrected" on corrected readings"""
    level: LightLevel
    error: float
    """Median over the blocks, relative"""
    outliers: float
    """Share of blocks that are off by more than 25 %"""


def _answers(records: Sequence[FlowRecord], sensor: str) -> dict[str, list[_Answer]]:
    """Return the errors on a sensor by method, the brightest level first."""
    found: dict[str, list[_Answer]] = {}
    for each in sorted(records, key=lambda each: -illuminance_of(each.level)):
        if each.sensor == sensor and each.truth:
            for ending, errors in (("", each.truth.counts), (", corrected", each.truth.corrected)):
                if errors and errors.relative_error_median is not None:
                    name, share = f"{each.method}{ending}", errors.outlier_fraction or 0.0
                    answer = _Answer(name, each.level, errors.relative_error_median, share)
                    found.setdefault(name, []).append(answer)
    return found


def _least_light(records: Sequence[FlowRecord], sensor: str) -> _Answer | None:
    """Return the answer at the least light down to which a method is accurate.

    Brighter levels at which it fails, for example by saturation, are skipped.
    """
    reached = []
    for own in _answers(records, sensor).values():
        from_first = dropwhile(lambda each: each.error >= ACCURATE, own)
        reached += list(takewhile(lambda each: each.error < ACCURATE, from_first))[-1:]
    return min(reached, key=lambda each: (illuminance_of(each.level), each.error), default=None)


def _reach(records: Sequence[FlowRecord], sensor: str) -> tuple[str, str, str]:
    """Return the method that is accurate down to the least light, this light, and its error."""
    if found := _least_light(records, sensor):
        return found.method, level_name(found.level), percent(found.error)
    every = chain.from_iterable(_answers(records, sensor).values())
    best = min(
        every, key=lambda each: (each.error, -illuminance_of(each.level), each.method), default=None
    )
    if best is None:
        return UNDEFINED, UNDEFINED, UNDEFINED
    return best.method, "none", f"{percent(best.error)} at {level_name(best.level)}"


_GLOSSARY = {
    "Radiance": "light from a place in a direction, per area, solid angle and wavelength "
    "(W·m⁻²·sr⁻¹·nm⁻¹), independent of any sensor.",
    "Illuminance": "photopic light on a level surface under the open sky (lux).",
    "Photons": "mean number on a pixel in one exposure; its efficiency is the share detected.",
    "Events": "detections that reach a pixel's counter, including dark counts, afterpulses and "
    "crosstalk, after losses by dead time.",
    "Reading": "output of a counter, which may saturate, wrap around or have an offset.",
    "Shot noise": "standard deviation of photon counts, the square root of their mean.",
    "Dark counts": "detections without a photon, at a rate that differs between pixels.",
    "Dead time": "time after a detection in which a pixel detects nothing.",
    "Saturated": "a reading at the pixel's limit, a lower bound.",
    "Corrected": "readings after correction for dark counts, dead time, counter, flat field and "
    "hot pixels.",
    "True motion": "displacement of the point at a pixel's center from one frame to the next (px, "
    "to the right and down).",
    "Occluded": "hidden, or out of view, in the other frame.",
    "Parallax": "motion due to the camera's translation, larger for near objects.",
    "Endpoint error (EPE)": "distance between a velocity and the true one (px).",
    "N_2b": "photons per frame, summed over all pixels, at which a detector's error is 25 % "
    "(2 bits).",
    "Fixed error": "part of the rendered light's error that is the same in all frames "
    "and moves with the surfaces.",
}

_STAND_IN = (
    "Within 25 % of the flow by DIS between the clean pictures, a stand-in for the unknown true "
    "motion that favors DIS."
)
_RANKING = (
    "Endpoint error against the true motion, on perfect pixels. Illuminance and exposure set the "
    "photons. {} {} This holds for this scene, path and settings. All curves, poolings and the "
    "camera’s motion are in {}/ranking.html next to this page."
)
_MADE = (
    "The settings below, with their seeds, reproduce everything on this page. Only the noise of "
    "rendering may differ between machines, within its statistics."
)
_FILES = """
dataset.yaml                 all settings and the version that made it
sequences/SEQ.json           software of each stage, and every file's hash
timings.json                 seconds each stage took
training/clean, final        tone-mapped radiance; counts of the first sensor and level (PNG)
training/flow                true motion to the next frame (.flo, px)
training/occlusions, invalid pixels without a match, without defined motion (PNG)
training/depth, camdata_left depth (.dpt, m) and camera (.cam)
radiance                     spectral radiance, W·m⁻²·sr⁻¹·nm⁻¹ per band (EXR)
truth                        motion both ways, depth, normals, objects, occlusion (EXR)
radiance_shutter             radiance through the shutter, as sensors see it, if there is one (EXR)
truth_shutter                truth of every row at its own time, with a rolling shutter (EXR)
counts                       counts, noise-free mean and saturation per sensor and level (Zarr)
results                      responses (Zarr), errors and photon benchmark (JSON, CSV)"""


def ranking_section(report: Report) -> Section | None:
    """Return the ranking against the true motion; None if it was not computed."""
    ranking = read_ranking(report.dataset.root / FOLDER)
    if ranking is None:
        return None
    return Section(
        "Which method is best",
        _RANKING.format(best_methods(ranking), " ".join(order_changes(ranking)), FOLDER),
        body=block("card", atlas(ranking)) + paragraph(ATLAS, "note"),
        name="ranking",
        link="Which is best",
    )


def making_section(report: Report) -> Section:
    """Return times, versions, settings and files."""
    samples = f"Light paths per pixel: {report.settings.render.samples_per_pixel}; four times "
    remark = rendering(report.scene, f"{samples}as many halve the noise of a frame.")
    variant = ""
    if report.has_truth:
        variant = f"Rendered with Mitsuba’s variant {report.scene.get('variant', 'not noted')}."
    total = time_text(sum(report.timings.values()))
    body = [
        remark,
        definitions("versions", rendering_errors(report.scene)),
        block(
            "pair",
            card(f"Time spent: {total}", _bars(report), paragraph(variant, "note")),
            card(
                "Software that wrote this report",
                definitions("versions", versions.versions().items()),
            ),
        ),
        folded("All settings", Markup("<pre>{}</pre>").format(to_yaml(report.settings))),
        folded("Files", Markup("<pre>{}</pre>").format(_FILES)),
    ]
    return Section("How it was made", _MADE, body=Markup("\n").join(body), name="made")


def _bars(report: Report) -> Markup:
    longest = max(report.timings.values(), default=0.0) or 1.0
    bar = Markup('<span>{}</span><i style="width:{:.1f}%"></i><span>{}</span>')
    bars = (
        bar.format(stage, 100 * spent / longest, time_text(spent))
        for stage, spent in report.timings.items()
    )
    return block("bars", *bars)


SECTIONS: tuple[Callable[[Report], Section | None], ...] = (
    light_section,
    motion_section,
    detector_section,
    threshold_section,
    ranking_section,
    lambda _: Section("Glossary", body=definitions("words", _GLOSSARY.items()), name="words"),
    making_section,
)
"""Sections of the page and its navigation, in order; None is skipped."""


def write_report(dataset: Dataset) -> Path:
    """Write DATASET/report.html from the finished stages; return its path.

    Raises UserError if nothing was rendered yet, or a file cannot be read.
    """
    path = dataset.root / "report.html"
    write_text(path, page(dataset))
    return path


def page(dataset: Dataset) -> str:
    """Return the report as HTML."""
    report = Report(dataset)
    sections = (make(report) for make in SECTIONS)
    settings, shown = report.settings, report.shown
    return page_of(
        title(settings),
        lead(settings, report.scene),
        sections,
        header=_opening(report),
        film=report.film(),
        footer=(
            f"Written by megalopta {versions.versions()['megalopta']}. Pictures show "
            f"{f'one of {shown.step} × {shown.step} pixels and ' if shown.step > 1 else ''}"
            f"{len(shown.frames)} of {settings.trajectory.frames} frames; the last one has no next "
            "frame, so no motion."
        ),
    )


def _opening(report: Report) -> Markup:
    """Return key numbers and results."""
    counted = list(facts(report))
    # per row, for rows of nearly equal length
    many, few = (math.ceil(len(counted) / math.ceil(len(counted) / most)) for most in (8, 4))
    tiles = block("", definitions("facts", counted), style=f"--many:{many};--few:{few}")
    rows = outcome(report.flow, report.exposures)
    if not rows:
        return tiles
    name, reach = _farthest(report)
    results = table("Results", OUTCOME, rows)
    note = "" if report.has_truth else _STAND_IN
    shown = paragraph(reach), strip(report, name), results, paragraph(note, "note")
    return tiles + block("outcome", Markup("<h2>Results</h2>"), *shown)


def _farthest(report: Report) -> tuple[str, str]:
    """Return the sensor on which motion is seen in the least light, and a sentence on it.

    Without such a sensor, the first.
    """
    names = [sensor.name for sensor in report.settings.sensors]
    if not report.flow:
        return names[0], ""
    reached = {name: each for name in names if (each := _least_light(report.flow, name))}
    if not reached:
        return names[0], f"No method stays within 25 % of the {report.motion_name} at any level."
    sensor = min(reached, key=lambda name: illuminance_of(reached[name].level))
    found = reached[sensor]
    return sensor, (
        f"{found.method} on {sensor} stays within 25 % of the {report.motion_name} down to "
        f"{level_title(found.level)}: the median error of its blocks is {percent(found.error)}, "
        f"and {percent(found.outliers)} of them are off by more than 25 %."
    )


_MOST_LEVELS = 4


def strip(report: Report, sensor: str) -> Markup:
    """Return the strip of one sensor; nothing without readings.

    It has its light levels, and the flow of the best method in the brightest if one ran.
    """
    own = by_sensor(report.exposures).get(sensor, [])
    if not own:
        return Markup("")
    brightest_first = sorted(own, key=lambda each: -each.illuminance_lux)
    brightest = brightest_first[0]
    found = report.shown.found_flow(brightest.sensor, brightest.level)
    flow = found and report.shown.film(found, f"{found.name} at {found.level}")
    return block(
        "strip",
        film(None, "light", "The scene's light, tone-mapped"),
        *(counts_film(report, each) for each in with_ends(brightest_first, _MOST_LEVELS)),
        flow or Markup(""),
        flow_film(report) if report.shown.motions else Markup(""),
    )
