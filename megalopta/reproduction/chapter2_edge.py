"""Figures of §2.4.8: an edge crosses SPADCAM, and what NDM and NDS make of it.

Each shows the bench twice, with the shot noise of the light alone and with all that the model of
SPADCAM knows. How the experiment is made is said in `motion_bench`. Of peak responses over the
velocity of the edge the dissertation gives one signal-to-noise ratio per detector and no
definition. Here it is 20·log10 of the mean peak response of one detector over its standard
deviation between crossings, averaged over all speeds but standstill.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from megalopta.camera.motion_bench import (
    FRAME_RATE_HZ,
    FRAMES,
    OPEN_PHOTONS,
    PIXELS,
    SENSORS,
    SPEEDS_MM_S,
    TIME_CONSTANTS_S,
    UNITS,
    Peaks,
    detector,
    filter_step,
    peaks,
    pixels_per_frame,
    pooled,
    record,
)
from megalopta.core.arrays import Floats
from megalopta.flow.detectors.correlation import ndm_mean, nds_mean
from megalopta.plotting.picture import Figure
from megalopta.plotting.style import BLACK, BLUE, GRAY, GREEN, ORANGE, VERMILION
from megalopta.reproduction.drawing import FigureRecipe, Run
from megalopta.scenes.stimuli.motion_bench import MotionBench
from megalopta.sensor import Sensor

_SPEED_MM_S = 1.0
_SPEED = f"{_SPEED_MM_S:g} mm/s, {pixels_per_frame(_SPEED_MM_S):.2f} px per frame"
SHOWN_DETECTOR = 4
_FRAMES_CAPTION = (
    f"The edge moves by {_SPEED}; photons are those detected, and SPADCAM's dark counts come on "
    "top. In its 16 rows {:.1f} % of the counts are full, with a hot pixel's dark counts."
)


def recording(sensor: Sensor) -> Floats:
    """Pooled frames (2·FRAMES, 12) of the first row in the first recording at the lowest speed."""
    return pooled(record(_SPEED_MM_S, sensor).counts)[:, 0]


def responses(method: str, frames: Floats) -> Floats:
    """Responses (T, 10) of the detectors of one row (T, 12)."""
    return detector(method).respond(frames[:, np.newaxis])[:, 0, 1:-1]


def _figure_2_14(_: Run) -> Figure:
    frames = {name: recording(sensor)[:FRAMES] for name, sensor in SENSORS.items()}
    bright, hidden = OPEN_PHOTONS, OPEN_PHOTONS * MotionBench().shade
    full = 100 * record(_SPEED_MM_S, SENSORS["SPADCAM"]).saturated.mean()
    contrast = {
        "difference over sum": (bright - hidden) / (bright + hidden),
        "difference over open": 1 - hidden / bright,
    }
    printed = {
        "Photons per pixel, open and hidden": (f"{bright:g} and {hidden:g}", "65 and 27"),
        "Photons per open frame": (f"{PIXELS * bright:.0f}", "roughly 1k"),
    }
    for how, share in contrast.items():
        printed[f"Contrast, {how}"] = (f"{100 * share:.0f} %", "64 %, undefined")
    for name, shown in frames.items():
        ends = f"{shown[0].mean():.0f} and {shown[-1].mean():.0f}"
        printed[f"First and last mean, {name}"] = (ends, "—")
    return Figure(
        title="Figure 2.14: 32 frames of a row of 12 pooled pixels as an edge passes",
        caption=_FRAMES_CAPTION.format(full),
        printed=printed,
        **frame_maps(frames, "Pixel", "Counts"),
    )


def _response_figure(name: str, method: str) -> Figure:
    maps = {
        label: responses(method, recording(sensor)[:FRAMES]) for label, sensor in SENSORS.items()
    }
    before = slice(detector(method).memory_frames, FRAMES // 4)
    return Figure(
        title=f"Figure {name.removeprefix('fig-')}: {method} in the frames of Figure 2.14",
        caption=(
            "Each panel shows ten detectors with time constants of "
            f"{1e3 * TIME_CONSTANTS_S[method]:.0f} ms at {FRAME_RATE_HZ:g} frames/s. The table has "
            "the mean of their largest responses, and that of their responses before the edge "
            "comes; the dissertation gives no numbers."
        ),
        printed={
            f"Edge and baseline, {label}": (
                f"{shown.max(axis=0).mean():.3g} and {shown[before].mean():.2g} {UNITS[method]}",
                "a weak baseline",
            )
            for label, shown in maps.items()
        },
        **frame_maps(maps, "Detector", f"Response ({UNITS[method]})"),
    )


def _figure_2_17(_: Run) -> Figure:
    curves = {name: transients(recording(sensor)) for name, sensor in SENSORS.items()}
    return Figure(
        title="Figure 2.17: one pooled pixel and its detectors as an edge passes and returns",
        caption=(
            f"The edge moves by {_SPEED}, as in the dissertation, and every curve is divided by "
            "its largest value. Dark counts lift SPADCAM's pixel; the high-pass of the detectors "
            "leaves only the noise of them."
        ),
        **transient_panels(curves),
    )


def transients(frames: Floats) -> dict[str, Floats]:
    """One pooled pixel and its detectors, of the frames (2·FRAMES, 12) of a row."""
    answers = {name: responses(name, frames)[:, SHOWN_DETECTOR] for name in ("NDM", "NDS")}
    return {"pooled pixel": frames[:, SHOWN_DETECTOR + 1], **answers}


def transient_panels(curves: Mapping[str, Mapping[str, Floats]]) -> dict[str, Any]:
    """Drawing, numbers and height of a figure of `transients`, one above the other."""
    time_s = np.arange(2 * FRAMES) / FRAME_RATE_HZ
    styles = {"pooled pixel": ("-", GRAY), "NDM": ("-", BLUE), "NDS": ("--", VERMILION)}

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(len(curves), 1, sharex=True)
        for axes, (name, lines) in zip(panels, curves.items(), strict=True):
            for label, line in lines.items():
                dash, color = styles[label]
                axes.plot(time_s, line / line.max(), dash, color=color, label=label, lw=1.7)
            axes.set_title(name, loc="left")
            axes.set(ylim=(0, 1.05), ylabel="Share of largest")
        panels[0].set_xlim(0, time_s[-1])
        panels[0].legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3)
        panels[-1].set_xlabel("Time (s)")

    numbers = {
        f"{csv_name(name)}_{csv_name(label)}": line
        for name, lines in curves.items()
        for label, line in lines.items()
    }
    return {"draw": draw, "numbers": {"time_s": time_s, **numbers}, "height_in": 4.6}


def frame_maps(
    maps: Mapping[str, Floats], across: str, unit: str, *, one_scale: bool = False
) -> dict[str, Any]:
    """Drawing, numbers and height of a figure of frames (T, n) side by side."""
    ends = [min(each.min() for each in maps.values()), max(each.max() for each in maps.values())]
    clim = ends if one_scale else None

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(1, len(maps), sharey=True)
        for axes, (name, rows) in zip(panels, maps.items(), strict=True):
            extent = (0.5, rows.shape[1] + 0.5, len(rows) + 0.5, 0.5)
            image = axes.imshow(
                rows, aspect="auto", interpolation="nearest", extent=extent, clim=clim
            )
            axes.grid(visible=False)
            axes.set_title(name, loc="left")
            axes.set_xlabel(across)
            axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
            bar = canvas.colorbar(image, ax=axes)
        bar.set_label(unit)
        panels[0].set_ylabel("Frame")

    numbers = {
        f"{csv_name(name)}_{across.lower()}_{number}": column
        for name, rows in maps.items()
        for number, column in enumerate(rows.T, 1)
    }
    frames = np.arange(1.0, FRAMES + 1)
    return {"draw": draw, "numbers": {"frame": frames, **numbers}, "height_in": 3.8}


def csv_name(label: str) -> str:
    """A label as part of the name of a column."""
    return label.lower().replace(" ", "_")


THEORY_CYCLES = 0.5
"""Cycles of the theoretical sinusoid along the row; the dissertation says only: below 1."""
PRINTED_SNR_DB = {"NDM": 12.6, "NDS": 15.7}
SHEET_DARK_COUNTS = 1.77 * 360 * 0.1
"""Hz/µm² (§2.4.7) · µm² · s."""
_EQUATIONS = {"NDM": "Eq. 4.2", "NDS": "Eq. 4.3, corrected"}
_MEANS = {"NDM": ndm_mean, "NDS": nds_mean}
_NOISELESS = "edge without noise"


def measured_peaks(method: str) -> dict[str, list[Peaks]]:
    """Return peak responses at every speed, for each noise model."""
    return {
        name: [peaks(speed, sensor)[method] for speed in SPEEDS_MM_S]
        for name, sensor in SENSORS.items()
    }


def mean_snr_db(over_speeds: Sequence[Peaks]) -> float:
    """Return the mean over all speeds but standstill, which comes first."""
    return float(np.mean([each.snr_db for each in over_speeds[1:]]))


def theory(method: str, velocity: Floats) -> Floats:
    """Return the mean response to a sinusoid of contrast 1 that moves so many pixels per frame."""
    phase = 2 * np.pi * THEORY_CYCLES / PIXELS
    return _MEANS[method](filter_step(method), phase * velocity, phase, 1.0)


class OverSpeeds(NamedTuple):
    """Peaks of one detector over the speed of the plate, of each of two recordings."""

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

    def theory(self, velocity: Floats) -> Floats:
        """Return the theoretical curve, as high as the peaks without noise."""
        scale = self.ideal.max() / theory(self.method, self.velocity).max()
        return np.asarray(scale * theory(self.method, velocity))

    def columns(self) -> dict[str, Floats]:
        """Return the numbers at every speed by the names of their columns."""
        return {
            "speed_mm_s": np.array(self.speeds_mm_s, float),
            "velocity_px_per_frame": self.velocity,
            "theoretical": self.theory(self.velocity),
            "without_noise": self.ideal,
            **{
                f"{csv_name(label)}_{what}": values
                for label, own in self.found.items()
                for what, values in _statistics(own).items()
            },
        }

    def draw(self, axes: Axes, snr_db: Mapping[str, float]) -> None:
        """Draw peak responses with their standard deviations, and what they should be."""
        velocity, styles = self.velocity, (("o", BLUE, -0.1), ("s", ORANGE, 0.1))
        fine = np.linspace(0, velocity[-1], 201)
        curve = self.theory(fine)
        axes.plot(fine, curve, "--", color=BLACK, lw=1.6, label="theoretical, sinusoid")
        line = "-" if velocity.size > 1 else "_"
        axes.plot(velocity, self.ideal, line, color=GREEN, lw=1.6, ms=24, label=_NOISELESS)
        for (label, own), (marker, color, shift) in zip(self.found.items(), styles, strict=True):
            each = _statistics(own)
            look: dict[str, Any] = {"fmt": marker, "color": color, "capsize": 3, "lw": 1.4}
            look["label"] = f"{label}, mean SNR {snr_db[label]:.1f} dB"
            axes.errorbar(velocity + shift, each["mean"], each["sigma"], **look)
        axes.set_ylim(0, None)
        axes.set_ylabel(f"Peak response ({UNITS[self.method]})")
        axes.legend(loc="lower right")


def _figure(number: str, method: str) -> Figure:
    found = measured_peaks(method)
    over = OverSpeeds(method, SPEEDS_MM_S, found)
    return Figure(
        title=f"Figure {number}: peak response of {method} to an edge over its velocity",
        caption=_peaks_caption(method, found),
        printed=_printed(method, found, float(over.ideal[2] / over.ideal[1])),
        draw=partial(_draw_peaks, over=over),
        numbers=over.columns(),
    )


def _draw_peaks(canvas: Canvas, over: OverSpeeds) -> None:
    axes = canvas.subplots()
    over.draw(axes, {label: mean_snr_db(own) for label, own in over.found.items()})
    axes.set(xlabel="Image velocity (pixels/frame)")


def _statistics(over_speeds: Sequence[Peaks]) -> dict[str, Floats]:
    return {
        "mean": np.array([each.mean for each in over_speeds]),
        "sigma": np.array([each.deviation for each in over_speeds]),
        "snr_db": np.array([each.snr_db for each in over_speeds]),
    }


def _peaks_caption(method: str, found: dict[str, list[Peaks]]) -> str:
    crossings, rows, detectors = found["Poisson noise only"][0].noisy.shape
    return (
        "Points are the mean and σ of the largest response of one detector while an edge crosses, "
        f"over {crossings} crossings of {detectors} detectors in each of {rows} rows, with time "
        f"constants of {1e3 * TIME_CONSTANTS_S[method]:.0f} ms and, in SPADCAM, "
        f"{SHEET_DARK_COUNTS:.0f} dark counts per pixel and frame. The SNR is 20·log10(mean/σ), "
        "averaged over the speeds but 0; the dissertation does not define its own. The theoretical "
        f"curve is the mean response ({_EQUATIONS[method]}) to a sinusoid of {THEORY_CYCLES:g} "
        "cycles along the row, scaled to the same height."
    )


def _printed(
    method: str, found: dict[str, list[Peaks]], growth: float
) -> dict[str, tuple[str, str]]:
    """Return SNR, NDM behind NDS (a product doubles relative noise: 6 dB), and linearity."""
    rows_db = np.mean([each.row_snr_db for each in found["SPADCAM"][1:]], axis=0)
    sums, products = measured_peaks("NDS"), measured_peaks("NDM")
    behind = [mean_snr_db(sums[label]) - mean_snr_db(products[label]) for label in sums]
    return {
        **{
            f"SNR, {label}": (
                f"{mean_snr_db(over_speeds):.1f} dB",
                f"{PRINTED_SNR_DB[method]} dB, one row",
            )
            for label, over_speeds in found.items()
        },
        "SNR of single rows, SPADCAM": (f"{rows_db.min():.1f} to {rows_db.max():.1f} dB", "—"),
        "NDM behind NDS": (
            f"{min(behind):.1f} to {max(behind):.1f} dB",
            f"{PRINTED_SNR_DB['NDS'] - PRINTED_SNR_DB['NDM']:.1f} dB",
        ),
        "Growth from 1.67 to 3.33 px/frame": (f"{growth:.2f} times", "fairly linear below 4"),
    }


RECIPES = (
    FigureRecipe("fig-2.14", _figure_2_14),
    FigureRecipe("fig-2.15", lambda _: _response_figure("fig-2.15", "NDM")),
    FigureRecipe("fig-2.16", lambda _: _response_figure("fig-2.16", "NDS")),
    FigureRecipe("fig-2.17", _figure_2_17),
    FigureRecipe("fig-2.18", lambda _: _figure("2.18", "NDM")),
    FigureRecipe("fig-2.19", lambda _: _figure("2.19", "NDS")),
)
