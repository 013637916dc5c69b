"""Figures of §2.4.8: an edge crosses SPADCAM, and what NDM and NDS make of it.

Each shows the bench twice, with the shot noise of the light alone and with all that the model of
SPADCAM knows. How the experiment is made is said in `motion_bench`.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from megalopta.camera.motion_bench import (
    FRAME_RATE_HZ,
    FRAMES,
    OPEN_PHOTONS,
    PIXELS,
    SENSORS,
    TIME_CONSTANTS_S,
    UNITS,
    detector,
    pixels_per_frame,
    pooled,
    record,
)
from megalopta.core.arrays import Floats
from megalopta.plotting.picture import Figure
from megalopta.plotting.style import BLUE, GRAY, VERMILION
from megalopta.reproduction.figure_recipe import FigureRecipe, Run
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


RECIPES = (
    FigureRecipe("fig-2.14", _figure_2_14),
    FigureRecipe("fig-2.15", lambda _: _response_figure("fig-2.15", "NDM")),
    FigureRecipe("fig-2.16", lambda _: _response_figure("fig-2.16", "NDS")),
    FigureRecipe("fig-2.17", _figure_2_17),
)
