"""Figures of §2.4.8 from recordings: an edge crosses SPADCAM, with the responses of NDM and NDS.

`megalopta spadcam figures` draws captured results with simulated ones; both pass through the same
pooling, detectors and statistics. `motion_bench` documents the experiment, and
`examples/dissertation` draws the simulation alone. The dissertation gives one signal-to-noise ratio
of peak responses over the velocity of the edge per detector, without definition. Here it is
20·log10 of the mean peak response of one detector over its standard deviation between crossings,
averaged over all speeds except 0. `megalopta spadcam compare --scene plate` tests the differences.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from megalopta.camera import comparison, motion_bench as bench
from megalopta.camera.motion_bench import BenchLight, Peaks
from megalopta.camera.recording import RecordingFrames, Source, read_recorded
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError, refused_as
from megalopta.core.folders import ensure_directory
from megalopta.core.progress import working
from megalopta.flow.detectors.correlation import ndm_mean, nds_mean
from megalopta.plotting import style
from megalopta.plotting.picture import Figure, write_figure
from megalopta.sensor import Sensor, changed, load_sensor
from megalopta.sensor.calibrate.level import Level

_SHOWN = 4
"""Detector whose responses are drawn over time"""
_CURVES = {"pooled_pixel": ("-", style.GRAY), "NDM": ("-", style.BLUE), "NDS": ("--", style.ORANGE)}
_THEORY_CYCLES = 0.5
"""Cycles of the theoretical sinusoid along the row; the dissertation states only: below 1."""
_PRINTED_SNR_DB = {"NDM": 12.6, "NDS": 15.7}
_MEANS = {"NDM": ndm_mean, "NDS": nds_mean}


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
    counts = {
        "simulated": bench.record(slowest, sensor, light).counts,
        "captured": captured[slowest],
    }
    rows = {name: bench.pooled(frames)[:, 0] for name, frames in counts.items()}
    caption = (
        f"The edge moves by {slowest:g} mm/s, {bench.pixels_per_frame(slowest):.2f} px per frame. "
    )
    caption += (
        f"Simulated in the light fitted to this recording, in which {light}."
        if light
        else "Simulated in the dissertation's light: an open pixel detects "
        f"{bench.OPEN_PHOTONS:g} photons per frame."
    )
    title = "frames of a row of 12 pooled pixels as an edge passes"
    yield _map_figure("2.14", title, rows, "pixel", "counts", caption)
    responses = {
        method: {name: _responses(method, frames) for name, frames in rows.items()}
        for method in ("NDM", "NDS")
    }
    for number, method in (("2.15", "NDM"), ("2.16", "NDS")):
        constant_ms = 1e3 * bench.TIME_CONSTANTS_S[method]
        text = (
            f"Each panel shows ten detectors with time constants of {constant_ms:.0f} ms at "
            f"{bench.FRAME_RATE_HZ:g} frames/s."
        )
        title = f"{method} in the frames of Figure 2.14"
        unit = f"response ({bench.UNITS[method]})"
        yield _map_figure(number, title, responses[method], "detector", unit, text)
    yield _transients(rows, responses, caption)
    direct = [bench.peaks(speed, sensor, light) for speed in speeds]
    for number, method in (("2.18", "NDM"), ("2.19", "NDS")):
        simulated = [peaks[method] for peaks in direct]
        crossings = [
            bench.crossing_peaks(bench.detector(method), bench.pooled(captured[speed]))
            for speed in speeds
        ]
        recorded = [
            Peaks(*both) for both in zip(crossings, (p.ideal for p in simulated), strict=True)
        ]
        yield _over_speeds(number, method, speeds, {"simulated": simulated, "captured": recorded})


def _responses(method: str, frames: Floats) -> Floats:
    """Responses (T, 10) of the detectors of one row (T, 12)."""
    return bench.detector(method).respond(frames[:, np.newaxis])[:, 0, 1:-1]


def _map_figure(
    number: str, title: str, rows: Mapping[str, Floats], across: str, unit: str, caption: str
) -> Figure:
    """Draw the frames (T, n) of a row as an edge passes, a panel per recording."""
    shown = {name: frames[: bench.FRAMES] for name, frames in rows.items()}
    ends = [min(map(np.min, shown.values())), max(map(np.max, shown.values()))]
    columns = {
        f"{name}_{across}_{place}": column
        for name, frames in shown.items()
        for place, column in enumerate(frames.T, 1)
    }

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(1, len(shown), sharey=True)
        for axes, (name, frames) in zip(panels, shown.items(), strict=True):
            extent = (0.5, frames.shape[1] + 0.5, len(frames) + 0.5, 0.5)
            look: dict[str, Any] = {"aspect": "auto", "interpolation": "nearest", "clim": ends}
            image = axes.imshow(frames, extent=extent, **look)
            axes.grid(visible=False)
            axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
            axes.set_title(name, loc="left")
            axes.set_xlabel(across)
            canvas.colorbar(image, ax=axes, label=unit if axes is panels[-1] else "")
        panels[0].set_ylabel("frame")

    return Figure(
        title=f"Figure {number}, captured: {title}",
        caption=caption,
        draw=draw,
        numbers={"frame": np.arange(1.0, bench.FRAMES + 1), **columns},
        height_in=3.8,
        name=f"fig-{number}",
    )


def _transients(
    rows: Mapping[str, Floats], responses: Mapping[str, Mapping[str, Floats]], caption: str
) -> Figure:
    """Draw Figure 2.17: one pooled pixel and its detectors, a panel per recording."""
    time_s = np.arange(2 * bench.FRAMES) / bench.FRAME_RATE_HZ
    curves = {
        name: {"pooled_pixel": frames[:, _SHOWN + 1]}
        | {method: found[name][:, _SHOWN] for method, found in responses.items()}
        for name, frames in rows.items()
    }

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(len(curves), 1, sharex=True)
        for axes, (name, lines) in zip(panels, curves.items(), strict=True):
            for label, line in lines.items():
                dash, color = _CURVES[label]
                axes.plot(time_s, line / line.max(), dash, color=color, label=label, lw=1.7)
            axes.set_title(name, loc="left")
            axes.set(ylim=(0, 1.05), ylabel="share of largest")
        panels[0].legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3)
        panels[-1].set(xlabel="time (s)", xlim=(0, time_s[-1]))

    divided = "Every curve is divided by its largest value; the time between passages is omitted."
    columns = {
        f"{name}_{label}": line for name, lines in curves.items() for label, line in lines.items()
    }
    return Figure(
        title="Figure 2.17, captured: one pooled pixel and its detectors as an edge passes and "
        "returns",
        caption=f"{caption} {divided}",
        draw=draw,
        numbers={"time_s": time_s, **columns},
        height_in=4.6,
        name="fig-2.17",
    )


def _over_speeds(
    number: str, method: str, speeds: Sequence[float], found: Mapping[str, Sequence[Peaks]]
) -> Figure:
    """Draw Figure 2.18 or 2.19: peaks of one detector over the speed of the plate (mm/s)."""
    velocity = np.array([bench.pixels_per_frame(speed) for speed in speeds])
    ideal = np.array([peaks.ideal.mean() for peaks in found["simulated"]])
    fine, phase = np.linspace(0, velocity[-1], 201), 2 * np.pi * _THEORY_CYCLES / bench.PIXELS
    mean = partial(_MEANS[method], bench.filter_step(method))
    scale = ideal.max() / mean(phase * velocity, phase, 1.0).max()
    columns = {
        f"{name}_{what}": np.array([getattr(peaks, field) for peaks in over])
        for name, over in found.items()
        for what, field in (("mean", "mean"), ("sigma", "deviation"), ("snr_db", "snr_db"))
    }
    moving = np.array(speeds) > 0
    snr_db = {name: float(columns[f"{name}_snr_db"][moving].mean()) for name in found}

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        theory = scale * mean(phase * fine, phase, 1.0)
        axes.plot(fine, theory, "--", color=style.BLACK, label="theoretical, sinusoid")
        line = "-" if velocity.size > 1 else "_"
        axes.plot(velocity, ideal, line, color=style.GREEN, ms=24, label="edge without noise")
        looks = (("o", style.BLUE, -0.1), ("s", style.ORANGE, 0.1))
        for name, (marker, color, shift) in zip(found, looks, strict=True):
            look: dict[str, Any] = {"fmt": marker, "color": color, "capsize": 3, "lw": 1.4}
            look["label"] = f"{name}, mean SNR {snr_db[name]:.1f} dB"
            axes.errorbar(
                velocity + shift, columns[f"{name}_mean"], columns[f"{name}_sigma"], **look
            )
        axes.set(xlabel="image velocity (pixels/frame)", ylim=(0, None))
        axes.set_ylabel(f"peak response ({bench.UNITS[method]})")
        axes.legend(loc="lower right")

    crossings, rows, detectors = found["simulated"][0].noisy.shape
    one_row = f"{_PRINTED_SNR_DB[method]} dB, one row"
    return Figure(
        title=f"Figure {number}, captured: peak response of {method} to an edge over its velocity",
        caption=(
            "Points are the mean and σ of the largest response of one detector while an edge "
            f"crosses, over {crossings} crossings of {detectors} detectors in each of {rows} rows. "
            "The SNR is 20·log10(mean/σ), averaged over the speeds but 0; the dissertation does "
            "not define its own. The theoretical curve is the mean response to a sinusoid of "
            f"{_THEORY_CYCLES:g} cycles along the row, scaled to the same height."
        ),
        draw=draw,
        numbers={
            "speed_mm_s": np.array(speeds, float),
            "velocity_px_per_frame": velocity,
            "theoretical": scale * mean(phase * velocity, phase, 1.0),
            "without_noise": ideal,
            **columns,
        },
        printed={f"SNR, {name}": (f"{value:.1f} dB", one_row) for name, value in snr_db.items()},
        name=f"fig-{number}",
    )


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
        counts = comparison.captured_frames(each, sensor, 0.0) if device else frames
        cut.setdefault(source.light, []).append(comparison.passages_at(source.light, counts))
    captured = {speed: np.concatenate(parts) for speed, parts in cut.items()}
    slowest = min(speed for speed in captured if speed > 0)
    light = comparison.light_at(slowest, captured[slowest], sensor) if own_light else None
    ensure_directory(out)
    with working("figures"):
        for figure in captured_figures(captured, sensor, light):
            yield from write_figure(figure, out)


def _recorded(source: Source) -> RecordingFrames:
    recorded = read_recorded(source)
    frame_s = float(np.median(np.diff(recorded.times_s))) if len(recorded.times_s) > 1 else 0.1
    if not np.allclose((recorded.exposure_s, frame_s), 1 / bench.FRAME_RATE_HZ, rtol=0.01):
        raise UserError(
            f"{source.path}: frames of {recorded.exposure_s:g} s every {frame_s:g} s; capture with "
            f"--rate {bench.FRAME_RATE_HZ:g} --exposure {1 / bench.FRAME_RATE_HZ:g}"
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
