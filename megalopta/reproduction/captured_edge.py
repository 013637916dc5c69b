"""Figures of §2.4.8 from recordings: an edge crosses SPADCAM, with the responses of NDM and NDS.

Captured and simulated frames pass through the same pooling, detectors and statistics
(`motion_bench`). The dissertation gives one signal-to-noise ratio per detector, without definition.
Here it is 20·log10 of the mean peak response of one detector over its standard deviation between
crossings, averaged over all speeds except 0.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from megalopta.camera import comparison, motion_bench as bench
from megalopta.camera.sources import Source, read_recorded
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError, refused_as
from megalopta.core.folders import ensure_directory
from megalopta.core.progress import working
from megalopta.report import style
from megalopta.reproduction.picture import Figure, write_figure
from megalopta.sensor import Sensor, changed, load_sensor
from megalopta.sensor.calibrate.level import Level

_METHODS = ("NDM", "NDS")
_PRINTED_SNR_DB = {"NDM": 12.6, "NDS": 15.7}


def captured_figures(captured: Mapping[float, NDArray[Any]], sensor: Sensor) -> Iterator[Figure]:
    """Yield the figures: 2.14 to 2.17 in one, and 2.18 and 2.19 in one.

    `captured`: frames (passages · 2·FRAMES, 16, 16) of `cut_passages` by the plate's speed (mm/s);
    `sensor`: of the simulation, with the same exposure.
    """
    speeds = sorted(captured)
    slowest = speeds[0]
    simulated = bench.record(slowest, sensor).counts
    counts = {"simulated": simulated, "captured": captured[slowest]}
    lit = f"dissertation's light: an open pixel detects {bench.OPEN_PHOTONS:g} photons a frame."
    speed = f"{slowest:g} mm/s, {bench.pixels_per_frame(slowest):.2f} px per frame"
    caption = f"The edge moves by {speed}. Simulated in the {lit}"
    yield _passage({name: bench.pooled(frames)[:, 0] for name, frames in counts.items()}, caption)
    direct = [bench.peaks(speed, sensor) for speed in speeds]
    peaks: dict[tuple[str, str], list[bench.Peaks]] = {}
    for method in _METHODS:
        ours = peaks["simulated", method] = [by_method[method] for by_method in direct]
        peaks["captured", method] = [
            bench.Peaks(
                bench.crossing_peaks(bench.detector(method), bench.pooled(captured[speed])), ideal
            )
            for speed, (_, ideal) in zip(speeds, ours, strict=True)
        ]
    yield _over_speeds(speeds, peaks)


def _passage(rows: Mapping[str, Floats], caption: str) -> Figure:
    """Draw the pooled frames (2·FRAMES, 12) of a row as an edge passes, and their responses."""
    time_s = np.arange(2 * bench.FRAMES) / bench.FRAME_RATE_HZ
    maps: dict[tuple[str, str], Floats] = {}
    for name, frames in rows.items():
        maps[name, "counts"] = frames
        for method in _METHODS:
            responses = bench.detector(method).respond(frames[:, np.newaxis])
            maps[name, method] = responses[:, 0, 1:-1]

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(len(rows), 4)
        for (name, content), frames in maps.items():
            row = list(rows).index(name)
            axes = panels[row, ["counts", *_METHODS].index(content)]
            look: dict[str, Any] = {"aspect": "auto", "interpolation": "nearest"}
            canvas.colorbar(axes.imshow(frames[: bench.FRAMES], **look), ax=axes)
            axes.grid(visible=False)
            axes.set_title(f"{content}, {name}", fontsize=9, loc="left")
            axes.set(xlabel="pixel" if content == "counts" else "detector", ylabel="frame")
            curve = frames[:, 4 + (content == "counts")]  # of one detector
            panels[row, 3].plot(time_s, curve / curve.max(), label=content)
        for axes in panels[:, 3]:
            axes.set(ylim=(0, 1.05), xlabel="time (s)", ylabel="share of largest")
        panels[0, 3].legend(loc="lower right", fontsize=8)

    columns = {
        f"{name}_{content}_{place}": column
        for (name, content), frames in maps.items()
        for place, column in enumerate(frames.T, 1)
    }
    return Figure(
        title="Figures 2.14 to 2.17, captured: a row of 12 pooled pixels and its detectors as an "
        "edge passes",
        caption=f"{caption} Curves are of one pixel and its detectors as the edge passes and "
        "returns, divided by their largest value; the time between passages is omitted.",
        draw=draw,
        numbers=pd.DataFrame({"time_s": time_s, **columns}),
        height_in=4.6,
        name="fig-2.14-to-2.17",
    )


def _over_speeds(
    speeds: Sequence[float], peaks: Mapping[tuple[str, str], Sequence[bench.Peaks]]
) -> Figure:
    """Draw peak responses over the speed of the plate (mm/s), by recording and method."""
    velocity = np.array([bench.pixels_per_frame(speed) for speed in speeds])
    columns = {
        f"{name}_{method}_{statistic}": np.array([getattr(result, field) for result in over])
        for (name, method), over in peaks.items()
        for statistic, field in (("mean", "mean"), ("sigma", "deviation"), ("snr_db", "snr_db"))
    }
    snr = [
        f"{method} {name} {columns[f'{name}_{method}_snr_db'].mean():.1f} dB (dissertation, one "
        f"row: {_PRINTED_SNR_DB[method]} dB)"
        for name, method in peaks
    ]

    def draw(canvas: Canvas) -> None:
        for axes, method in zip(canvas.subplots(1, 2), _METHODS, strict=True):
            ideal = np.array([result.ideal.mean() for result in peaks["simulated", method]])
            axes.plot(velocity, ideal, "-" if velocity.size > 1 else "_", color=style.GREEN, ms=24)
            looks = (("simulated", "o", style.BLUE), ("captured", "s", style.ORANGE))
            for shift, (name, marker, color) in zip((-0.1, 0.1), looks, strict=True):
                key = f"{name}_{method}"
                look: dict[str, Any] = {"fmt": marker, "color": color, "capsize": 3, "label": name}
                ends = columns[f"{key}_mean"], columns[f"{key}_sigma"]
                axes.errorbar(velocity + shift, *ends, **look)
            axes.set(title=method, xlabel="image velocity (pixels/frame)", ylim=(0, None))
            axes.set_ylabel(f"peak response ({bench.UNITS[method]})")
            axes.legend(loc="lower right")

    crossings, rows, detectors = peaks["simulated", "NDM"][0].noisy.shape
    return Figure(
        title="Figures 2.18 and 2.19, captured: peak responses to an edge over its velocity",
        caption=(
            "Points are the mean and σ of the largest response of one detector while an edge "
            f"crosses, over {crossings} crossings of {detectors} detectors in each of {rows} rows. "
            "The SNR is 20·log10(mean/σ), averaged over the speeds but 0; the dissertation does "
            f"not define its own: {', '.join(snr)}. Green: without noise."
        ),
        draw=draw,
        numbers=pd.DataFrame(
            {"speed_mm_s": np.array(speeds, float), "velocity_px_per_frame": velocity, **columns}
        ),
        name="fig-2.18-and-2.19",
    )


def reproduce_captured(
    sources: Sequence[Source], out: Path, device: Path | None = None
) -> Iterator[Path]:
    """Draw figures 2.14 to 2.19 from recordings and simulations; yield the paths of their files.

    Sources are recordings of the plate, with its speed (mm/s) in place of the light; several of one
    speed are joined. A device file simulates, and its steps convert codes to counts; default: the
    nominal sensor of the recordings. Files of the same name are replaced. Raises
    UserError if device or recordings cannot be read, or show no passages; nothing is written then.
    """
    if not all(source.light > 0 for source in sources):
        raise UserError("figures: no speed of the plate; give it with each recording, such as a@5")
    recorded = [read_recorded(source) for source in sources]
    first, frame_s = recorded[0], 1 / bench.FRAME_RATE_HZ
    for source, frames in zip(sources, recorded, strict=True):
        period_s = np.median(np.diff(frames.times_s)) if len(frames.times_s) > 1 else frame_s
        if not np.allclose((frames.exposure_s, period_s), frame_s, rtol=0.01):
            raise UserError(
                f"{source.path}: frames of {frames.exposure_s:g} s every {period_s:g} s; capture"
                f" with --rate {bench.FRAME_RATE_HZ:g} --exposure {frame_s:g}"
            )
        if device is None and (frames.sensor is None or frames.sensor != first.sensor):
            raise UserError(
                f"{source.path}: another sensor or step than {sources[0].path}; give recordings "
                "with the same settings, or --device"
            )
    if device is not None:
        with refused_as("--device", OSError):
            sensor = changed(load_sensor(device, Sensor), exposure_s=first.exposure_s)
    else:
        assert first.sensor is not None
        sensor = changed(first.sensor, counter={"calibrated": False})
    cut: dict[float, list[NDArray[Any]]] = {}
    for source, recording in zip(sources, recorded, strict=True):
        counts = Level(recording.counts, recording.exposure_s, 0.0, times_s=recording.times_s)
        if device:
            counts = comparison.captured_frames(recording, sensor, 0.0)
        cut.setdefault(source.light, []).append(comparison.passages_at(source.light, counts))
    captured = {speed: np.concatenate(parts) for speed, parts in cut.items()}
    ensure_directory(out)
    with working("figures"):
        for figure in captured_figures(captured, sensor):
            yield from write_figure(figure, out)
