"""`megalopta view`: a film and a page of a dataset, a recording, or a file of frames or events."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup

from megalopta import __version__
from megalopta.core.errors import UserError
from megalopta.core.progress import progress
from megalopta.report import images
from megalopta.report.panels import (
    LONGEST_SIDE_PX,
    MOST_FRAMES,
    Panel,
    View,
    file_view,
    sequence_view,
)
from megalopta.report.readings import Treatment, read_mask
from megalopta.report.sections import Section, block, write_sections
from megalopta.report.text import number
from megalopta.sensor.formats.reading import FrameKind

_FILM_FRAMES = 300
_STRIP_PX = 16_000
"""Height of the frames of a page above each other, which browsers must be able to draw"""
_MOST_EXPOSURES = 4
"""Of a film"""
_UNTIMED_HZ = 12.0
"""Playback rate of frames without times, Hz"""


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


def view(
    thing: str | Path, out: str | Path = "out/view", asked: ViewOptions | None = None
) -> list[Path]:
    """Write film.mp4, film.gif and view.html of a thing into a folder; return their paths.

    The thing is a dataset, of one sequence or of many, of which a contact sheet is written instead,
    a recording, or a file or folder of frames or events. film.mp4 needs PyAV (extra `video`).

    Raises UserError where it is none of these, is damaged, or cannot be shown as asked.
    """
    from megalopta.dataset.opened import open_dataset
    from megalopta.report.dataset_card import SHOWN, write_contact_sheet

    thing, folder, asked = Path(thing), Path(out), asked or ViewOptions()
    is_dataset = (thing / "dataset.yaml").exists()
    if is_dataset and len(open_dataset(thing)) > 1:
        if asked != ViewOptions():
            raise UserError(
                f"{thing}: many sequences have only a contact sheet; omit --sum and similar options"
            )
        return [write_contact_sheet(thing, SHOWN, folder)]
    if is_dataset and asked.kind:
        raise UserError(f"{thing}: a dataset states its own format; omit --format {asked.kind}")
    bad = read_mask(asked.bad_pixels) if asked.bad_pixels else None
    treatment = Treatment(asked.summed, asked.is_inverted, bad)
    if is_dataset:
        shown = sequence_view(thing, treatment)
    else:
        shown = file_view(thing, treatment, asked.kind)
    page = _write_page(shown, folder / "view.html", asked.fps)
    return [*_write_film(shown, folder, asked.fps), page]


def _exposures(shown: View) -> tuple[list[str], list[str]]:
    """Return names of sensors, and of light levels from the darkest on."""
    readings = shown.of("readings")
    sensors = dict.fromkeys(panel.sensor for panel in readings)
    return list(sensors), list(dict.fromkeys(panel.level for panel in readings))


def _playback_hz(shown: View, frames: int, fps: float | None) -> float:
    """Return the rate of so many frames, evenly spaced: real time if that can be followed."""
    if fps or shown.rate_hz is None:
        return fps or _UNTIMED_HZ
    slowest, fastest = images.PLAYBACK_HZ
    return min(max(shown.rate_hz * frames / len(shown.frames), slowest), fastest)


def _write_film(shown: View, folder: Path, fps: float | None) -> list[Path]:
    """Write the film.

    Of exposures it has few, from the brightest on: the first sensor's, or at one light level of all
    sensors; of flow by a method, that in the brightest.
    """
    sensors, levels = _exposures(shown)
    varied = "level" if len(levels) > 1 else "sensor"
    readings = shown.of("readings")[::-1]
    if varied == "level":
        readings = [panel for panel in readings if panel.sensor == sensors[0]]
    readings = list(images.evenly_spaced(readings, _MOST_EXPOSURES))
    brightest = [(panel.sensor, panel.level) for panel in readings[:1]]
    flow = [panel for panel in shown.of("flow") if (panel.sensor, panel.level) in brightest]
    panels = [*shown.of("light"), *readings, *flow, *shown.of("motion")]
    titles = [f"{panel.name}, {getattr(panel, varied)}".rstrip(", ") for panel in panels]
    constant = (sensors if varied == "level" else levels)[:1]
    notes = filter(None, dict.fromkeys([*constant, *(panel.note for panel in panels)]))
    remarks = "".join(f" · {note}" for note in notes)
    frames = images.evenly_spaced(shown.frames, _FILM_FRAMES)
    with progress("Drawing the film", len(frames), "frame") as advance:

        def moments() -> Iterator[tuple[str, images.Row]]:
            for frame in frames:
                label = images.frame_label(frame, shown.times_s, shown.treatment.summed)
                pictures = (panel.picture(frame) for panel in panels)
                yield f"{label}{remarks}", list(zip(titles, pictures, strict=True))
                advance()

        playback_hz = _playback_hz(shown, len(frames), fps)
        return images.write_film(folder, moments(), len(frames), playback_hz)


def _write_page(shown: View, path: Path, fps: float | None) -> Path:
    """Write the page: one film of light and motion, and of the chosen sensor and level."""
    films = len(shown.of("readings")) + 2 * len(shown.of("light", "motion"))
    most = min(MOST_FRAMES, _STRIP_PX * shown.step // shown.shape[0])
    frames, step = images.selection(shown.frames, shown.shape, films, LONGEST_SIDE_PX, most)
    sensors, levels = _exposures(shown)
    parts = []
    with progress("Drawing the page", len(shown.panels), "panel") as advance:
        for panel in shown.panels:
            parts.append(_chosen(panel, panel.film(frames), sensors, levels))
            advance()
    body = block("panels", *parts) + (images.wheel(shown.rim) if shown.rim else "")
    heading = "Side by side" if len(parts) > 1 else "What was read"
    playback_hz = _playback_hz(shown, len(frames), fps)
    treatment = shown.treatment.description() if shown.of("readings") else ""
    speed = ""
    if shown.rate_hz is not None:
        slower = shown.rate_hz * len(frames) / len(shown.frames) / playback_hz
        ratio = f"{number(max(slower, 1 / slower))} times {'slower' if slower > 1 else 'faster'}"
        is_real = abs(slower - 1) < 0.02
        speed = f"It plays {'in real time' if is_real else f'{ratio} than in reality'}."
    total, filmed = len(shown.frames), min(len(shown.frames), _FILM_FRAMES)
    left_out = "all pixels" if step == 1 else f"one of {step} × {step} pixels"
    left_out += f" and {f'all {total}' if len(frames) == total else f'{len(frames)} of {total}'}"
    left_out += " frames" + (f"; the film has {filmed}" if filmed > len(frames) else "")
    choices: list[dict[str, Any]] = [
        {"name": "sensor", "title": "sensor", "texts": sensors, "is_slider": False},
        {"name": "level", "title": "light", "texts": levels, "is_slider": True},
    ]
    film: dict[str, Any] = {
        "labels": [
            images.frame_label(frame, shown.times_s, shown.treatment.summed) for frame in frames
        ],
        "start": len(frames) // 2,
        "playback_hz": playback_hz,
        "choices": [choice for choice in choices if len(choice["texts"]) > 1],
        "aspect": f"{shown.shape[1]}/{shown.shape[0]}",
        "radiance": "",
        "note": "",
    }
    return write_sections(
        path,
        shown.title,
        " ".join(filter(None, (shown.summary, treatment, speed))),
        [Section(heading, body=body)],
        film=film,
        footer=f"Written by megalopta {__version__}. The page shows {left_out}.",
    )


def _chosen(panel: Panel, film: Markup, sensors: list[str], levels: list[str]) -> Markup:
    """Return a film, of readings and flow shown only where sensor and level are chosen."""
    if panel.kind in ("light", "motion"):
        return block("", film)
    places = sensors.index(panel.sensor), levels.index(panel.level)
    is_first = places == (0, len(levels) - 1)
    return Markup('<div class="chosen" data-sensor="{}" data-level="{}"{}>{}</div>').format(
        *places, "" if is_first else Markup(" hidden"), film
    )
