"""`megalopta spadcam figures`: figures 2.14 to 2.19 from recordings of the moving plate.

Captured results are drawn with simulated ones; both pass through the same pooling, detectors and
statistics. `megalopta spadcam compare --scene plate` tests the differences.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from megalopta.camera.comparison import captured_frames, light_at, passages_at
from megalopta.camera.motion_bench import (
    FRAME_RATE_HZ,
    OPEN_PHOTONS,
    BenchLight,
    Peaks,
    crossing_peaks,
    detector,
    peaks,
    pooled,
    record,
)
from megalopta.camera.recording import RecordingFrames, Source, read_recorded
from megalopta.core.errors import UserError, refused_as
from megalopta.core.folders import ensure_directory
from megalopta.core.progress import working
from megalopta.plotting.picture import Figure, write_figure
from megalopta.reproduction.chapter2_edge import (
    OverSpeeds,
    frames_figure,
    moves,
    responses_figure,
    transients_figure,
)
from megalopta.sensor import Sensor, changed, load_sensor
from megalopta.sensor.calibrate.level import Level


def captured_figures(
    captured: Mapping[float, NDArray[Any]], sensor: Sensor, light: BenchLight | None = None
) -> Iterator[Figure]:
    """Yield the figures.

    Parameters
    ----------
    captured : mapping
        Frames (passages · 2·FRAMES, 16, 16), as `cut_passages` cuts them, by the
        plate's speed (mm/s), at least one of which is not 0.
    sensor : Sensor
        Sensor of the simulation, with the same exposure.
    light : BenchLight, optional
        Light of the simulation; default: the dissertation's.
    """
    speeds = sorted(captured)
    slowest = next(speed for speed in speeds if speed > 0)
    counts = {"Simulated": record(slowest, sensor, light).counts, "Captured": captured[slowest]}
    rows = {name: pooled(each)[:, 0] for name, each in counts.items()}
    caption = f"{moves(slowest)}. {_lit(light)}"
    yield _named("2.14", frames_figure(rows, caption, {}, one_scale=True))
    for number, method in (("2.15", "NDM"), ("2.16", "NDS")):
        yield _named(number, responses_figure(number, method, rows, one_scale=True))
    divided = "Every curve is divided by its largest value; the time between passages is omitted."
    yield _named("2.17", transients_figure(rows, f"{caption} {divided}"))
    direct = [peaks(speed, sensor, light) for speed in speeds]
    for number, method in (("2.18", "NDM"), ("2.19", "NDS")):
        ours = [each[method] for each in direct]
        theirs = [
            Peaks(crossing_peaks(detector(method), pooled(captured[speed])), same.ideal)
            for speed, same in zip(speeds, ours, strict=True)
        ]
        over = OverSpeeds(method, speeds, {"Simulated": ours, "Captured": theirs})
        yield _named(number, over.figure(number, "", {}))


def _named(number: str, figure: Figure) -> Figure:
    title = figure.title.replace(":", ", captured:", 1)
    return replace(figure, name=f"fig-{number}", title=title)


def _lit(light: BenchLight | None) -> str:
    if light is None:
        return (
            f"Simulated in the dissertation's light: an open pixel detects {OPEN_PHOTONS:g} "
            "photons per frame."
        )
    return f"Simulated in the light fitted to this recording, in which {light}."


def reproduce_captured(
    sources: Sequence[Source], out: Path, device: Path | None = None, *, own_light: bool = False
) -> Iterator[Path]:
    """Draw figures 2.14 to 2.19 from recordings and simulations; yield the paths of their files.

    Sources are recordings of the plate, with its speed (mm/s) in place of the light; several of one
    speed are joined. A device file simulates, and its steps convert codes to counts; default: the
    nominal sensor of the recordings. With `own_light`, the light is estimated from the recording of
    the slowest plate, instead of the dissertation's. Files of the same name are replaced. Raises
    UserError if device or recordings cannot be read, or show no passages; nothing is written then.
    """
    if not any(source.light > 0 for source in sources):
        raise UserError(
            "figures: only a plate at rest; give recordings with its speed, such as a@5"
        )
    recorded = [_recorded(source) for source in sources]
    sensor = _sensor(sources, recorded, device)
    cut: dict[float, list[NDArray[Any]]] = {}
    for source, each in zip(sources, recorded, strict=True):
        frames = Level(each.counts, each.exposure_s, 0.0, times_s=each.times_s)
        counts = captured_frames(each, sensor, 0.0) if device else frames
        cut.setdefault(source.light, []).append(passages_at(source.light, counts))
    captured = {speed: np.concatenate(parts) for speed, parts in cut.items()}
    slowest = min(speed for speed in captured if speed > 0)
    light = light_at(slowest, captured[slowest], sensor) if own_light else None
    ensure_directory(out)
    with working("figures"):
        for figure in captured_figures(captured, sensor, light):
            yield from write_figure(figure, out)


def _recorded(source: Source) -> RecordingFrames:
    recorded = read_recorded(source)
    frame_s = float(np.median(np.diff(recorded.times_s))) if len(recorded.times_s) > 1 else 0.1
    if not np.allclose((recorded.exposure_s, frame_s), 1 / FRAME_RATE_HZ, rtol=0.01):
        raise UserError(
            f"{source.path}: frames of {recorded.exposure_s:g} s every {frame_s:g} s; capture with "
            f"--rate {FRAME_RATE_HZ:g} --exposure {1 / FRAME_RATE_HZ:g}"
        )
    return recorded


def _sensor(
    sources: Sequence[Source], recorded: Sequence[RecordingFrames], device: Path | None
) -> Sensor:
    """Return the sensor of the simulation: a device file, or the nominal one of all recordings."""
    first = recorded[0]
    if device is not None:
        with refused_as("--device", OSError):
            return changed(load_sensor(device), exposure_s=first.exposure_s)
    for source, each in zip(sources, recorded, strict=True):
        if each.sensor is None or each.sensor != first.sensor:
            raise UserError(
                f"{source.path}: another sensor or step than {sources[0].path}; give recordings "
                "with the same settings, or --device"
            )
    assert first.sensor is not None
    return changed(first.sensor, counter={"calibrated": False})
