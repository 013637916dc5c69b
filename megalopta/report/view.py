"""`megalopta view`: a film and a page of a dataset, a recording, or a file of frames or events."""

import io
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from megalopta import __version__
from megalopta.core.errors import UserError
from megalopta.core.files import atomic_write
from megalopta.core.progress import progress
from megalopta.core.quantities import number
from megalopta.dataset.frames import read_truth_frame
from megalopta.dataset.opened import open_dataset
from megalopta.report import images
from megalopta.report.dataset_card import SHOWN, write_contact_sheet
from megalopta.report.panels import LONGEST_SIDE_PX, MOST_FRAMES, View, file_view, sequence_view
from megalopta.report.readings import Treatment, read_mask
from megalopta.report.sections import Section, block, write_sections
from megalopta.sensor.formats.reading import FrameKind

_FILM_FRAMES = 300
_STRIP_PX = 16_000
"""Height of the frames of a page above each other, which browsers must be able to draw"""
_PANEL_BYTES = 1_500_000
"""Of the frames of a panel on a page, which noise would exceed"""
_RERUN_FRAMES, _RERUN_POINTS = 60, 20_000
"""Most frames, and points of a frame"""
_PLACES = {"light": ["world", "camera", "light"], "readings": ["readings"]}
"""Nested entities of panels; default: their name"""


@dataclass(frozen=True)
class ViewOptions:
    """Options of a view."""

    summed: int = 1
    """Frames that are added up"""
    is_inverted: bool = False
    """True to invert the sensor's response"""
    bad_pixels: Path | None = None
    """A .npy file, true where a pixel is bad"""
    fps: float | None = None
    """Frames per second; by default real time, where that can be followed"""
    kind: FrameKind | None = None
    """Format of a file that does not say it"""
    with_rerun: bool = False
    """True to write view.rrd for the Rerun viewer"""


def view(
    thing: str | Path, out: str | Path = "out/view", options: ViewOptions | None = None
) -> list[Path]:
    """Write film.mp4, film.gif and view.html of a thing into a folder; return their paths.

    The thing is a dataset, of one sequence or of many, of which a contact sheet is written instead,
    "DATASET/SEQUENCE", a recording, or a file or folder of frames or events. film.mp4 needs PyAV
    (extra `video`), view.rrd the Rerun SDK (extra `rerun`).

    Raises UserError where it is none of these, is damaged, or cannot be shown as options.
    """
    thing, folder, options = Path(thing), Path(out), options or ViewOptions()
    is_of_many = not thing.exists() and (thing.parent / "dataset.yaml").exists()
    thing, name = (thing.parent, thing.name) if is_of_many else (thing, None)
    is_dataset = (thing / "dataset.yaml").exists()
    names = open_dataset(thing).names if is_dataset else ()
    if name is None and len(names) > 1:
        if options != ViewOptions():
            raise UserError(
                f"{thing}: many sequences have no film; omit options, or view {thing / names[0]}"
            )
        return [write_contact_sheet(thing, SHOWN, folder)]
    if is_dataset and options.kind:
        raise UserError(f"{thing}: a dataset states its own format; omit --format {options.kind}")
    bad = read_mask(options.bad_pixels) if options.bad_pixels else None
    treatment = Treatment(options.summed, options.is_inverted, bad)
    if is_dataset:
        shown = sequence_view(thing, treatment, name)
    else:
        shown = file_view(thing, treatment, options.kind)
    written = [write_rrd(folder / "view.rrd", shown)] if options.with_rerun else []
    page = _write_page(shown, folder / "view.html", options.fps)
    return [*_write_film(shown, folder, options.fps), page, *written]


def _exposures(shown: View) -> tuple[list[str], list[str]]:
    """Return names of sensors, and of light levels from the darkest on."""
    readings = shown.of("readings")
    sensors = dict.fromkeys(panel.sensor for panel in readings)
    return list(sensors), list(dict.fromkeys(panel.level for panel in readings))


def _write_film(shown: View, folder: Path, fps: float | None) -> list[Path]:
    """Write the film: few exposures, of one sensor or at one level, and flow in the brightest."""
    sensors, levels = _exposures(shown)
    varied, constant = ("level", sensors) if len(levels) > 1 else ("sensor", levels)
    readings = shown.of("readings")[::-1]
    if varied == "level":
        readings = [panel for panel in readings if panel.sensor == sensors[0]]
    readings = list(images.evenly_spaced(readings, 4))
    brightest = [(panel.sensor, panel.level) for panel in readings[:1]]
    flow = [panel for panel in shown.of("flow") if (panel.sensor, panel.level) in brightest]
    panels = [*shown.of("light"), *readings, *flow, *shown.of("motion")]
    titles = [f"{panel.name}, {getattr(panel, varied)}".rstrip(", ") for panel in panels]
    if shown.sequence is None:  # of a file, the one panel has no legend in a film
        titles = [f"{shown.title}: {panels[0].caption}"]
    notes = filter(None, dict.fromkeys([*constant[:1], *(panel.note for panel in panels)]))
    remarks = "".join(f" · {note}" for note in notes)
    frames = shown.frames[:: math.ceil(len(shown.frames) / _FILM_FRAMES)]
    player = shown.player(frames, fps)
    with progress("Drawing the film", len(frames), "frame") as advance:

        def moments() -> Iterator[tuple[str, images.Row]]:
            for frame, label in zip(frames, player.labels, strict=True):
                pictures = (panel.picture(frame) for panel in panels)
                yield f"{label}{remarks}", list(zip(titles, pictures, strict=True))
                advance()

        return images.write_film(folder, moments(), len(frames), player.playback_hz)


def _write_page(shown: View, path: Path, fps: float | None) -> Path:
    """Write the page: one film of light and motion, and of the chosen sensor and level."""
    films = len(shown.of("readings")) + 2 * len(shown.of("light", "motion"))
    pictures = (panel.picture(shown.frames[-1]) for panel in shown.panels)
    frame_bytes = max(len(images.data_uri(picture)) for picture in pictures)
    most = min(MOST_FRAMES, _STRIP_PX * shown.step // shown.shape[0], _PANEL_BYTES // frame_bytes)
    fitting, step = images.selection(shown.frames, shown.shape, films, LONGEST_SIDE_PX, most)
    total, summed = len(shown.frames), shown.treatment.summed if shown.of("readings") else 1
    unit = f"sums of {summed} frames" if summed > 1 else "frames"
    if shown.sequence and unit == "frames" and total < len(shown.sequence):
        unit = "frames with a next one"
    spacing, film_spacing = math.ceil(total / len(fitting)), math.ceil(total / _FILM_FRAMES)
    frames = shown.frames[::spacing]
    sensors, levels = _exposures(shown)
    player = replace(shown.player(frames, fps), sensors=sensors, levels=levels)
    chosen = Markup('<div class="chosen" data-sensor="{}" data-level="{}"{}>{}</div>')
    parts = []
    with progress("Drawing the page", len(shown.panels), "panel") as advance:
        for panel in shown.panels:
            film = panel.film(frames)
            if panel.kind in ("readings", "flow"):
                places = sensors.index(panel.sensor), levels.index(panel.level)
                is_first = places == (0, len(levels) - 1)
                parts.append(chosen.format(*places, "" if is_first else Markup(" hidden"), film))
            else:
                parts.append(block("", film))
            advance()
    body = block("panels", *parts) + (images.wheel(shown.rim) if shown.rim else "")
    sampled = f"Of {total} {unit}, the page shows one in {spacing}, the film one in {film_spacing}."
    if spacing == film_spacing == 1:
        sampled = f"Page and film show all {total} {unit}."
    summary = [shown.summary, sampled.replace("one in 1,", "all,").replace("one in 1.", "all.")]
    if shown.of("readings"):
        summary.append(shown.treatment.description())
    if player.real_hz is not None:
        slower = player.real_hz / player.playback_hz
        ratio = f"{number(max(slower, 1 / slower))} times {'slower' if slower > 1 else 'faster'}"
        is_real = abs(slower - 1) < 0.02
        summary.append(f"It plays {'in real time' if is_real else f'{ratio} than in reality'}.")
    pixels = "all pixels" if step == 1 else f"one of {step} × {step} pixels"
    return write_sections(
        path, shown.title, " ".join(filter(None, summary)),
        [Section("Side by side" if len(parts) > 1 else "Readings", body=body)],
        footer=f"Written by megalopta {__version__}. The page shows {pixels}.", player=player,
    )  # fmt: skip


def write_rrd(path: Path, shown: View) -> Path:
    """Write a view as .rrd for Rerun's viewer, in the world (z up, meters); return its path.

    Raises ModuleNotFoundError if the Rerun SDK is not installed.
    """
    import rerun

    frames = images.evenly_spaced(shown.frames, _RERUN_FRAMES)
    with atomic_write(path) as temporary, rerun.RecordingStream("megalopta") as recording:
        recording.save(temporary)
        if shown.sequence:
            recording.log(["world"], rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        with progress("Writing for Rerun", len(frames), "frame") as advance:
            for frame in frames:
                recording.set_time("frame", sequence=frame)
                if shown.times_s is not None:
                    recording.set_time("time", duration=float(shown.times_s[frame]))
                for panel in shown.panels:
                    names = *_PLACES.get(panel.kind, [panel.name]), panel.sensor, panel.level
                    data = io.BytesIO()
                    panel.picture(frame).convert("RGB").save(data, "PNG")
                    picture = rerun.EncodedImage(contents=data.getvalue(), media_type="image/png")
                    recording.log(["_".join(name.split()) for name in names if name], picture)
                for place, entity in _rerun_scene(rerun, shown, frame):
                    recording.log(place, entity)
                advance()
        recording.disconnect()
    return path


def _rerun_scene(rerun: Any, shown: View, frame: int) -> Iterator[tuple[list[str], Any]]:
    """Yield camera, pinhole and the points that the pixels see, with their places."""
    sequence, step = shown.sequence, shown.step
    if sequence is None:
        return
    frame //= shown.burst
    pose, camera = sequence.poses[frame], ["world", "camera"]
    yield camera, rerun.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3])
    if sequence.intrinsics is not None:  # a panorama has none
        matrix, (height, width) = sequence.intrinsics.copy(), sequence.shape
        matrix[:2] /= step
        size = [math.ceil(width / step), math.ceil(height / step)]
        axes = rerun.ViewCoordinates.RDF
        yield camera, rerun.Pinhole(image_from_camera=matrix, resolution=size, camera_xyz=axes)
    if sequence.configuration.scene.has_truth:
        (light,) = shown.of("light")
        colors = np.asarray(light.picture(frame * shown.burst).convert("RGB")).reshape(-1, 3)
        position = read_truth_frame(sequence.dataset, frame).position[::step, ::step].reshape(-1, 3)
        known = np.flatnonzero(np.isfinite(position).all(axis=-1))
        known = known[:: max(1, math.ceil(known.size / _RERUN_POINTS))]
        yield ["world", "points"], rerun.Points3D(position[known], colors=colors[known])
