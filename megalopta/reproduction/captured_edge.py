"""Figures of §2.4.8 from recordings: an edge crosses SPADCAM, with the responses of NDM and NDS.

`megalopta spadcam figures` draws captured results with simulated ones; both pass through the same
pooling, detectors and statistics. `motion_bench` documents the experiment, and
`examples/dissertation` draws the simulation alone. The dissertation gives one signal-to-noise ratio
of peak responses over the velocity of the edge per detector, without definition. Here it is
20·log10 of the mean peak response of one detector over its standard deviation between crossings,
averaged over all speeds except 0. `megalopta spadcam compare --scene plate` tests the differences.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from megalopta.camera.comparison import captured_frames, light_at, passages_at
from megalopta.camera.motion_bench import (
    FRAME_RATE_HZ,
    FRAMES,
    OPEN_PHOTONS,
    PIXELS,
    TIME_CONSTANTS_S,
    UNITS,
    BenchLight,
    Peaks,
    crossing_peaks,
    detector,
    filter_step,
    peaks,
    pixels_per_frame,
    pooled,
    record,
)
from megalopta.camera.recording import RecordingFrames, Source, read_recorded
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError, refused_as
from megalopta.core.folders import ensure_directory
from megalopta.core.progress import working
from megalopta.flow.detectors.correlation import ndm_mean, nds_mean
from megalopta.report.style import BLACK, BLUE, GRAY, GREEN, ORANGE, VERMILION
from megalopta.reproduction.picture import Figure, write_figure
from megalopta.sensor import Sensor, changed, load_sensor
from megalopta.sensor.calibrate.level import Level

_SHOWN_DETECTOR = 4
_CURVES = {"pooled pixel": ("-", GRAY), "NDM": ("-", BLUE), "NDS": ("--", VERMILION)}
_THEORY_CYCLES = 0.5
"""Cycles of the theoretical sinusoid along the row; the dissertation states only: below 1."""
_PRINTED_SNR_DB = {"NDM": 12.6, "NDS": 15.7}
_EQUATIONS = {"NDM": "Eq. 4.2", "NDS": "Eq. 4.3, corrected"}
_MEANS = {"NDM": ndm_mean, "NDS": nds_mean}

Rows: TypeAlias = Mapping[str, Floats]
"""Pooled frames (2·FRAMES, 12) of the first row of a recording, by sensor"""


def moves(speed_mm_s: float) -> str:
    """Return the motion of an edge and of its image, as text."""
    return f"The edge moves by {speed_mm_s:g} mm/s, {pixels_per_frame(speed_mm_s):.2f} px per frame"


def frames_figure(rows: Rows, caption: str) -> Figure:
    """Draw Figure 2.14: frames of a row as an edge passes."""
    shown = {name: each[:FRAMES] for name, each in rows.items()}
    ends = {
        f"First and last mean, {name}": (f"{each[0].mean():.0f} and {each[-1].mean():.0f}", "—")
        for name, each in shown.items()
    }
    return Figure(
        title="Figure 2.14: 32 frames of a row of 12 pooled pixels as an edge passes",
        caption=caption,
        printed=ends,
        **_frame_maps(shown, "Pixel", "Counts"),
    )


def responses_figure(number: str, method: str, rows: Rows) -> Figure:
    """Draw Figure 2.15 or 2.16: responses in the frames of Figure 2.14."""
    maps = {label: _responses(method, each[:FRAMES]) for label, each in rows.items()}
    before = slice(detector(method).memory_frames, FRAMES // 4)
    return Figure(
        title=f"Figure {number}: {method} in the frames of Figure 2.14",
        caption=(
            "Each panel shows ten detectors with time constants of "
            f"{1e3 * TIME_CONSTANTS_S[method]:.0f} ms at {FRAME_RATE_HZ:g} frames/s. The table has "
            "the means of their largest responses, and of their responses before the edge; the "
            "dissertation gives no numbers."
        ),
        printed={
            f"Edge and baseline, {label}": (
                f"{shown.max(axis=0).mean():.3g} and {shown[before].mean():.2g} {UNITS[method]}",
                "a weak baseline",
            )
            for label, shown in maps.items()
        },
        **_frame_maps(maps, "Detector", f"Response ({UNITS[method]})"),
    )


def transients_figure(rows: Rows, caption: str) -> Figure:
    """Draw Figure 2.17: one pooled pixel and its detectors, a panel per recording."""
    curves = {}
    for name, frames in rows.items():
        answers = {each: _responses(each, frames)[:, _SHOWN_DETECTOR] for each in ("NDM", "NDS")}
        curves[name] = {"pooled pixel": frames[:, _SHOWN_DETECTOR + 1], **answers}
    time_s = np.arange(2 * FRAMES) / FRAME_RATE_HZ
    numbers = {
        f"{_csv_name(name)}_{_csv_name(label)}": line
        for name, lines in curves.items()
        for label, line in lines.items()
    }
    return Figure(
        title="Figure 2.17: one pooled pixel and its detectors as an edge passes and returns",
        caption=caption,
        draw=partial(_draw_transients, time_s=time_s, curves=curves),
        numbers={"time_s": time_s, **numbers},
        height_in=4.6,
    )


class OverSpeeds(NamedTuple):
    """Peaks of one detector over the speed of the plate, for two recordings."""

    method: str
    speeds_mm_s: Sequence[float]
    found: Mapping[str, Sequence[Peaks]]

    @property
    def velocity(self) -> Floats:
        """Velocity of the image (px per frame)."""
        return np.array([pixels_per_frame(speed) for speed in self.speeds_mm_s])

    @property
    def ideal(self) -> Floats:
        """Mean peaks without noise, those of the first recording."""
        first = next(iter(self.found.values()))
        return np.array([each.ideal.mean() for each in first])

    @property
    def snr_db(self) -> dict[str, float]:
        """Signal-to-noise ratio of each recording, mean over all speeds except 0."""
        moving = [place for place, speed in enumerate(self.speeds_mm_s) if speed > 0]
        return {
            label: float(np.mean([own[place].snr_db for place in moving]))
            for label, own in self.found.items()
        }

    def theory(self, velocity: Floats) -> Floats:
        """Return the theoretical curve, scaled to the peaks without noise."""
        scale = self.ideal.max() / theory(self.method, self.velocity).max()
        return np.asarray(scale * theory(self.method, velocity))

    def figure(self, number: str) -> Figure:
        """Draw Figure 2.18 or 2.19."""
        crossings, rows, detectors = next(iter(self.found.values()))[0].noisy.shape
        one_row = f"{_PRINTED_SNR_DB[self.method]} dB, one row"
        ratios = {f"SNR, {name}": (f"{each:.1f} dB", one_row) for name, each in self.snr_db.items()}
        return Figure(
            title=f"Figure {number}: peak response of {self.method} to an edge over its velocity",
            caption=(
                "Points are the mean and σ of the largest response of one detector while an edge "
                f"crosses, over {crossings} crossings of {detectors} detectors in each of {rows} "
                f"rows, with time constants of {1e3 * TIME_CONSTANTS_S[self.method]:.0f} ms."
                " The SNR is 20·log10(mean/σ), averaged over the speeds but 0; the dissertation "
                "does not define its own. The theoretical curve is the mean response "
                f"({_EQUATIONS[self.method]}) to a sinusoid of {_THEORY_CYCLES:g} cycles along the "
                "row, scaled to the same height."
            ),
            printed=ratios,
            draw=self._draw,
            numbers=self._columns(),
        )

    def _columns(self) -> dict[str, Floats]:
        return {
            "speed_mm_s": np.array(self.speeds_mm_s, float),
            "velocity_px_per_frame": self.velocity,
            "theoretical": self.theory(self.velocity),
            "without_noise": self.ideal,
            **{
                f"{_csv_name(label)}_{what}": values
                for label, own in self.found.items()
                for what, values in _statistics(own).items()
            },
        }

    def _draw(self, canvas: Canvas) -> None:
        """Draw peak responses with their standard deviations, and theoretical curves."""
        axes, velocity = canvas.subplots(), self.velocity
        fine = np.linspace(0, velocity[-1], 201)
        curve = self.theory(fine)
        axes.plot(fine, curve, "--", color=BLACK, lw=1.6, label="theoretical, sinusoid")
        line = "-" if velocity.size > 1 else "_"
        axes.plot(velocity, self.ideal, line, color=GREEN, lw=1.6, ms=24, label=_NOISELESS)
        styles, ratios = (("o", BLUE, -0.1), ("s", ORANGE, 0.1)), self.snr_db
        for (label, own), (marker, color, shift) in zip(self.found.items(), styles, strict=True):
            each = _statistics(own)
            look: dict[str, Any] = {"fmt": marker, "color": color, "capsize": 3, "lw": 1.4}
            look["label"] = f"{label}, mean SNR {ratios[label]:.1f} dB"
            axes.errorbar(velocity + shift, each["mean"], each["sigma"], **look)
        axes.set_ylim(0, None)
        axes.set_ylabel(f"Peak response ({UNITS[self.method]})")
        axes.legend(loc="lower right")
        axes.set(xlabel="Image velocity (pixels/frame)")


_NOISELESS = "edge without noise"


def theory(method: str, velocity: Floats) -> Floats:
    """Return the mean response to a sinusoid of contrast 1 at a velocity in pixels per frame."""
    phase = 2 * np.pi * _THEORY_CYCLES / PIXELS
    return _MEANS[method](filter_step(method), phase * velocity, phase, 1.0)


def _responses(method: str, frames: Floats) -> Floats:
    """Responses (T, 10) of the detectors of one row (T, 12)."""
    return detector(method).respond(frames[:, np.newaxis])[:, 0, 1:-1]


def _draw_transients(
    canvas: Canvas, time_s: Floats, curves: Mapping[str, Mapping[str, Floats]]
) -> None:
    panels = canvas.subplots(len(curves), 1, sharex=True)
    for axes, (name, lines) in zip(panels, curves.items(), strict=True):
        for label, line in lines.items():
            dash, color = _CURVES[label]
            axes.plot(time_s, line / line.max(), dash, color=color, label=label, lw=1.7)
        axes.set_title(name, loc="left")
        axes.set(ylim=(0, 1.05), ylabel="Share of largest")
    panels[0].set_xlim(0, time_s[-1])
    panels[0].legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3)
    panels[-1].set_xlabel("Time (s)")


def _frame_maps(maps: Mapping[str, Floats], across: str, unit: str) -> dict[str, Any]:
    """Return drawing, numbers and height of a figure of frames (T, n) in a row."""
    ends = [min(each.min() for each in maps.values()), max(each.max() for each in maps.values())]
    numbers = {
        f"{_csv_name(name)}_{across.lower()}_{number}": column
        for name, rows in maps.items()
        for number, column in enumerate(rows.T, 1)
    }

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(1, len(maps), sharey=True)
        for axes, (name, rows) in zip(panels, maps.items(), strict=True):
            _draw_map(axes, rows, ends, unit if axes is panels[-1] else "")
            axes.set_title(name, loc="left")
            axes.set_xlabel(across)
        panels[0].set_ylabel("Frame")

    frames = np.arange(1.0, FRAMES + 1)
    return {"draw": draw, "numbers": {"frame": frames, **numbers}, "height_in": 3.8}


def _draw_map(axes: Axes, rows: Floats, clim: Sequence[float], unit: str) -> None:
    extent = (0.5, rows.shape[1] + 0.5, len(rows) + 0.5, 0.5)
    image = axes.imshow(rows, aspect="auto", interpolation="nearest", extent=extent, clim=clim)
    axes.grid(visible=False)
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    axes.figure.colorbar(image, ax=axes, label=unit)


def _statistics(over_speeds: Sequence[Peaks]) -> dict[str, Floats]:
    return {
        "mean": np.array([each.mean for each in over_speeds]),
        "sigma": np.array([each.deviation for each in over_speeds]),
        "snr_db": np.array([each.snr_db for each in over_speeds]),
    }


def _csv_name(label: str) -> str:
    """Return a label as part of a column name."""
    return label.lower().replace(" ", "_")


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
    yield _named("2.14", frames_figure(rows, caption))
    for number, method in (("2.15", "NDM"), ("2.16", "NDS")):
        yield _named(number, responses_figure(number, method, rows))
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
        yield _named(number, over.figure(number))


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
