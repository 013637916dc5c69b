"""Figures of §2.4.8: an edge crosses SPADCAM, and what NDM and NDS make of it.

Each shows the bench twice, with the shot noise of the light alone and with all that the model of
SPADCAM knows. How the experiment is made is said in `motion_bench`.
"""

from collections.abc import Mapping
from functools import partial

import numpy as np
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from megalopta.experiments import (
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
from megalopta.figures import (
    BLUE,
    GRAY,
    VERMILION,
    Figure,
    FigureRecipe,
    Floats,
    Printed,
    Run,
    rows_of,
)
from megalopta.scenes.stimuli import Bench
from megalopta.sensor import Sensor

SHOWN_MM_S = 1.0
_SHOWN_DETECTOR = 4


def recording(sensor: Sensor) -> Floats:
    """Pooled frames (2·FRAMES, 12) of the first row in the first recording at the lowest speed."""
    return pooled(record(SHOWN_MM_S, sensor).counts)[:, 0]


def responses(method: str, frames: Floats) -> Floats:
    """Responses (T, 10) of the detectors of one row (T, 12)."""
    return detector(method).respond(frames[:, np.newaxis])[:, 0, 1:-1]


def figure_2_14(_: Run) -> Figure:
    """Pooled frames as an edge passes."""
    frames = {name: recording(sensor)[:FRAMES] for name, sensor in SENSORS.items()}
    hidden = OPEN_PHOTONS * Bench().shade
    full = record(SHOWN_MM_S, SENSORS["SPADCAM"]).saturated.mean()
    columns, rows = _map_table(frames, "pixel")
    return Figure(
        name="fig-2.14",
        title="Figure 2.14: 32 frames of a row of 12 pooled pixels as an edge passes",
        caption=(
            f"The edge moves by {_speed()}; photons are those detected, and SPADCAM's dark counts "
            f"come on top. In its 16 rows {100 * full:.1f} % of the counts are full, with a hot "
            "pixel's dark counts."
        ),
        printed=(
            Printed(
                "Photons per pixel, open and hidden",
                f"{OPEN_PHOTONS:g} and {hidden:g}",
                "65 and 27",
            ),
            Printed("Photons per open frame", f"{PIXELS * OPEN_PHOTONS:.0f}", "roughly 1k"),
            Printed(
                "Contrast, difference over sum",
                f"{100 * (OPEN_PHOTONS - hidden) / (OPEN_PHOTONS + hidden):.0f} %",
                "64 %, undefined",
            ),
            Printed(
                "Contrast, difference over open",
                f"{100 * (1 - hidden / OPEN_PHOTONS):.0f} %",
                "64 %, undefined",
            ),
            *(
                Printed(
                    f"First and last mean, {name}",
                    f"{shown[0].mean():.0f} and {shown[-1].mean():.0f}",
                    "—",
                )
                for name, shown in frames.items()
            ),
        ),
        draw=partial(_draw_maps, frames, "Pixel", "Counts"),
        columns=columns,
        rows=rows,
        height_in=3.8,
    )


def _response_figure(name: str, method: str) -> Figure:
    maps = {
        label: responses(method, recording(sensor)[:FRAMES]) for label, sensor in SENSORS.items()
    }
    settled = detector(method).memory_frames
    columns, rows = _map_table(maps, "detector")
    return Figure(
        name=name,
        title=f"Figure {name.removeprefix('fig-')}: {method} in the frames of Figure 2.14",
        caption=(
            "Each panel shows ten detectors with time constants of "
            f"{1e3 * TIME_CONSTANTS_S[method]:.0f} ms at {FRAME_RATE_HZ:g} frames/s. The table has "
            "the mean of their largest responses, and that of their responses before the edge "
            "comes; the dissertation gives no numbers."
        ),
        printed=tuple(
            Printed(
                f"Edge and baseline, {label}",
                f"{shown.max(axis=0).mean():.3g} and {shown[settled : FRAMES // 4].mean():.2g} "
                f"{UNITS[method]}",
                "a weak baseline",
            )
            for label, shown in maps.items()
        ),
        draw=partial(_draw_maps, maps, "Detector", f"Response ({UNITS[method]})"),
        columns=columns,
        rows=rows,
        height_in=3.8,
    )


def figure_2_17(_: Run) -> Figure:
    """One pooled pixel and its detectors as the edge passes and returns."""
    curves = {}
    for name, sensor in SENSORS.items():
        frames = recording(sensor)
        curves[name] = {
            "pooled pixel": frames[:, _SHOWN_DETECTOR + 1],
            "NDM": responses("NDM", frames)[:, _SHOWN_DETECTOR],
            "NDS": responses("NDS", frames)[:, _SHOWN_DETECTOR],
        }
    time_s = np.arange(2 * FRAMES) / FRAME_RATE_HZ

    def draw(canvas: Canvas) -> None:
        panels = canvas.subplots(2, 1, sharex=True)
        for axes, (name, lines) in zip(panels, curves.items(), strict=True):
            for (label, line), color, dash in zip(
                lines.items(), (GRAY, BLUE, VERMILION), ("-", "-", "--"), strict=True
            ):
                axes.plot(time_s, line / line.max(), dash, color=color, label=label, lw=1.7)
            axes.set_title(name, loc="left")
            axes.set_ylim(0, 1.05)
            axes.set_ylabel("Share of largest")
        panels[0].set_xlim(0, time_s[-1])
        panels[0].legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3)
        panels[1].set_xlabel("Time (s)")

    return Figure(
        name="fig-2.17",
        title="Figure 2.17: one pooled pixel and its detectors as an edge passes and returns",
        caption=(
            f"The edge moves by {_speed()}, as in the dissertation, and every curve is divided by "
            "its largest value. Dark counts lift SPADCAM's pixel; the high-pass of the detectors "
            "leaves only the noise of them."
        ),
        draw=draw,
        columns=(
            "time_s",
            *(f"{csv_name(name)}_{csv_name(line)}" for name in curves for line in curves[name]),
        ),
        rows=rows_of(time_s, *(line for lines in curves.values() for line in lines.values())),
        height_in=4.6,
    )


def _draw_maps(maps: Mapping[str, Floats], across: str, unit: str, canvas: Canvas) -> None:
    panels = canvas.subplots(1, len(maps), sharey=True)
    for axes, (name, rows) in zip(panels, maps.items(), strict=True):
        extent = (0.5, rows.shape[1] + 0.5, len(rows) + 0.5, 0.5)
        image = axes.imshow(rows, aspect="auto", interpolation="nearest", extent=extent)
        axes.grid(visible=False)
        axes.set_title(name, loc="left")
        axes.set_xlabel(across)
        axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
        bar = canvas.colorbar(image, ax=axes)
    bar.set_label(unit)
    panels[0].set_ylabel("Frame")


def _map_table(
    maps: Mapping[str, Floats], across: str
) -> tuple[tuple[str, ...], tuple[tuple[float, ...], ...]]:
    """Columns and rows of the numbers behind maps."""
    columns = (
        f"{csv_name(name)}_{across}_{number}"
        for name, rows in maps.items()
        for number in range(1, rows.shape[1] + 1)
    )
    frames = np.arange(1.0, FRAMES + 1)
    return ("frame", *columns), rows_of(frames, *np.hstack(list(maps.values())).T)


def csv_name(label: str) -> str:
    """A label as part of the name of a column."""
    return label.lower().replace(" ", "_")


def _speed() -> str:
    return f"{SHOWN_MM_S:g} mm/s, {pixels_per_frame(SHOWN_MM_S):.2f} px per frame"


RECIPES = (
    FigureRecipe("fig-2.14", figure_2_14),
    FigureRecipe("fig-2.15", lambda _: _response_figure("fig-2.15", "NDM")),
    FigureRecipe("fig-2.16", lambda _: _response_figure("fig-2.16", "NDS")),
    FigureRecipe("fig-2.17", figure_2_17),
)
