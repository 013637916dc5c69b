"""`megalopta view`: a film and a page of a dataset, a recording, or a file of frames or events."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from markupsafe import Markup

from megalopta import __version__
from megalopta.core.errors import UserError
from megalopta.core.progress import progress
from megalopta.plotting.sections import Section, block, write_sections
from megalopta.plotting.text import number
from megalopta.report.film import Moment, write_film
from megalopta.report.images import (
    COLORS,
    PLAYBACK_HZ,
    Selection,
    evenly_spaced,
    frame_label,
    selection,
    wheel,
    with_ends,
)
from megalopta.report.readings import Treatment, read_mask
from megalopta.report.rerun_log import write_rrd
from megalopta.report.seen import (
    LONGEST_SIDE_PX,
    MOST_FRAMES,
    Panel,
    Seen,
    film_of,
    seen_readings,
)
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
    with_rerun: bool = False
    """True to write view.rrd for the Rerun viewer"""


class Choice(NamedTuple):
    """A control of the page: which of what is shown, a list or, of what is in order, a slider."""

    name: str
    title: str
    texts: list[str]
    is_slider: bool = False
    """It begins at its end."""


def view(
    thing: str | Path, out: str | Path = "out/view", asked: ViewOptions | None = None
) -> list[Path]:
    """Write film.mp4, film.gif and view.html of a thing into a folder; return their paths.

    The thing is a dataset, of one sequence or of many, of which a contact sheet is written instead,
    a recording, or a file or folder of frames or events. film.mp4 needs PyAV (extra `video`),
    view.rrd the Rerun SDK (extra `rerun`).

    Raises UserError where it is none of these, is damaged, or cannot be shown as asked.
    """
    thing, folder, asked = Path(thing), Path(out), asked or ViewOptions()
    is_dataset = (thing / "dataset.yaml").exists()
    if is_dataset and (sheet := _contact_sheet(thing, folder, asked)):
        return [sheet]
    bad = read_mask(asked.bad_pixels) if asked.bad_pixels else None
    treatment = Treatment(asked.summed, asked.is_inverted, bad)
    found = (_sequence if is_dataset else seen_readings)(thing, treatment, asked.kind)
    written = [write_rrd(folder / "view.rrd", found)] if asked.with_rerun else []
    page = _page(found, folder / "view.html", asked.fps)
    return [*_film(found, folder, asked.fps), page, *written]


def _contact_sheet(root: Path, folder: Path, asked: ViewOptions) -> Path | None:
    """Write the contact sheet of a dataset of many sequences; None of one."""
    from megalopta.dataset.opened import open_dataset
    from megalopta.report.dataset_card import SHOWN, write_contact_sheet

    if len(open_dataset(root)) <= 1:
        return None
    if asked != ViewOptions():
        raise UserError(
            f"{root}: many sequences have only a contact sheet; omit --sum and similar options"
        )
    return write_contact_sheet(root, SHOWN, folder)


def _sequence(root: Path, treatment: Treatment, kind: FrameKind | None) -> Seen:
    from megalopta.report.seen_sequence import seen_sequence

    if kind:
        raise UserError(f"{root}: a dataset states its own format; omit --format {kind}")
    return seen_sequence(root, treatment)


def _film(found: Seen, folder: Path, fps: float | None) -> list[Path]:
    frames, (panels, notes) = evenly_spaced(found.frames, _FILM_FRAMES), _in_film(found)
    with progress("Drawing the film", len(frames), "frame") as advance:

        def moments() -> Iterator[Moment]:
            for frame in frames:
                label = frame_label(frame, found.times_s, found.treatment.summed)
                pictures = [(label, each.picture(frame)) for label, each in panels]
                yield Moment(" · ".join([label, *notes]), pictures)
                advance()

        return write_film(folder, moments, len(frames), _rate(found, len(frames), fps))


def _in_film(found: Seen) -> tuple[list[tuple[str, Panel]], list[str]]:
    """Return panels with labels, and what is said of all.

    Of exposures there are few, from the brightest on: the first sensor's, or at one light level of
    all sensors; of what was found, the motion in the brightest.
    """
    sensors, levels = _choices(found)
    varied = "level" if len(levels) > 1 else "sensor"
    own = [e for e in found.of("readings") if varied == "sensor" or e.sensor == sensors[0]][::-1]
    chosen = with_ends(own, _MOST_EXPOSURES)
    best = [(each.sensor, each.level) for each in chosen[:1]]
    flow = [each for each in found.of("flow") if (each.sensor, each.level) in best]
    shown = [*found.of("light"), *chosen, *flow, *found.of("motion")]
    panels = [(f"{each.name}, {getattr(each, varied)}".rstrip(", "), each) for each in shown]
    constant = (sensors if varied == "level" else levels)[:1]
    notes = dict.fromkeys([*constant, *(each.note for each in shown)])
    return panels, [note for note in notes if note]


def _rate(found: Seen, shown: int, fps: float | None) -> float:
    """Return frames a second, so many of those that can be shown."""
    if fps or found.rate_hz is None:
        return fps or _UNTIMED_HZ
    slowest, fastest = PLAYBACK_HZ
    return min(max(found.rate_hz * shown / len(found.frames), slowest), fastest)


def _page(found: Seen, path: Path, fps: float | None) -> Path:
    films = len(found.of("readings")) + 2 * len(found.of("light", "motion"))
    most = min(MOST_FRAMES, _STRIP_PX * found.step // found.shape[0])
    chosen = selection(found.frames, found.shape, films, LONGEST_SIDE_PX, most)
    with progress("Drawing the page", len(found.panels), "panel") as advance:
        shown = [_drawn(found, panel, chosen, advance) for panel in found.panels]
    legend = wheel(COLORS.format(found.rim)) if found.rim else Markup("")
    section = Section(
        "Side by side" if len(shown) > 1 else "What was read",
        body=block("panels", *shown) + legend,
    )
    playback_hz = _rate(found, len(chosen.frames), fps)
    treated = found.treatment.description() if found.of("readings") else ""
    said = found.summary, treated, _speed(found, chosen, playback_hz)
    return write_sections(
        path,
        found.title,
        " ".join(filter(None, said)),
        [section],
        film=_transport(found, chosen, playback_hz),
        footer=_omitted(found, chosen),
    )


def _drawn(found: Seen, panel: Panel, chosen: Selection, advance: Callable[[], None]) -> Markup:
    """Return a panel as a film; of readings and flow, shown only where they are chosen."""
    inside = film_of(panel, chosen.frames)
    advance()
    if panel.kind in ("light", "motion"):
        return block("", inside)
    sensors, levels = _choices(found)
    places = sensors.index(panel.sensor), levels.index(panel.level)
    is_first = places == (0, len(levels) - 1)
    return Markup('<div class="chosen" data-sensor="{}" data-level="{}"{}>{}</div>').format(
        *places, "" if is_first else Markup(" hidden"), inside
    )


def _choices(found: Seen) -> tuple[list[str], list[str]]:
    """Return names of sensors, and of light levels from the darkest on."""
    readings = found.of("readings")
    sensors = dict.fromkeys(each.sensor for each in readings)
    return list(sensors), list(dict.fromkeys(each.level for each in readings))


def _transport(found: Seen, chosen: Selection, playback_hz: float) -> dict[str, Any]:
    """Return how the films of the page are moved, and which are shown."""
    sensors, levels = _choices(found)
    summed = found.treatment.summed
    choices = Choice("sensor", "sensor", sensors), Choice("level", "light", levels, True)
    return {
        "labels": [frame_label(each, found.times_s, summed) for each in chosen.frames],
        "start": len(chosen.frames) // 2,
        "playback_hz": playback_hz,
        "choices": [each for each in choices if len(each.texts) > 1],
        "aspect": f"{found.shape[1]}/{found.shape[0]}",
        "radiance": "",
        "note": "",
    }


def _speed(found: Seen, chosen: Selection, playback_hz: float) -> str:
    if found.rate_hz is None:
        return ""
    slower = found.rate_hz * len(chosen.frames) / len(found.frames) / playback_hz
    if abs(slower - 1) < 0.02:
        return "It plays in real time."
    if slower > 1:
        return f"It plays {number(slower)} times slower than in reality."
    return f"It plays {number(1 / slower)} times faster than in reality."


def _omitted(found: Seen, chosen: Selection) -> str:
    step, shown, total = chosen.step, len(chosen.frames), len(found.frames)
    pixels = "all pixels" if step == 1 else f"one of {step} × {step} pixels"
    frames = f"all {total} frames" if shown == total else f"{shown} of {total} frames"
    film = min(total, _FILM_FRAMES)
    more = f"; the film has {film}" if film > shown else ""
    return f"Written by megalopta {__version__}. The page shows {pixels} and {frames}{more}."
