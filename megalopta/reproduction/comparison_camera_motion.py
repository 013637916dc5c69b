"""Errors of the camera's own motion in forests, over the photons per pixel."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Canvas

from megalopta.benchmark.forest_flight import (
    FLIGHT_DRAWS,
    FLIGHT_FLUXES,
    FLIGHTS,
    MotionErrors,
    flight_errors,
    forest_flights,
    together,
)
from megalopta.benchmark.whole_frame_forests import forest_clips
from megalopta.core.arrays import Floats
from megalopta.core.progress import progress
from megalopta.plotting.picture import Cell, Figure, columns_of
from megalopta.plotting.style import BLACK, GRAY, draw_interval, legend_alone, method_style
from megalopta.plotting.text import UNDEFINED
from megalopta.reproduction.figure_recipe import FigureRecipe, Run

_YAW, _HEADING_DEG = 0.05, 5.0
_CAPTION = (
    "Root mean square error of the yaw rate over that of the rate ({:.2f}° per frame), and median "
    "error of the heading, in {} windows of eight frames of {} flights, {} draws of photons each "
    "({} × {} px, a pixel flickers by {:.0f} % by rendering); whiskers hold 95 % of bootstraps "
    "over windows. Summed: answers weighted as was learned from a flight's first half without "
    "noise, averaged over seven pairs; fitted: the motion that fits the flow of blocks; "
    "likelihood: that under which the counts are most likely. Only sums learn from these forests, "
    "and nothing but the camera moves in them: what moves by itself would mislead all ways."
)


def camera_motion(run: Run) -> Figure:
    """Yaw rate and heading from one likelihood, from flow, and from weighted sums of answers."""
    fluxes, draws = (FLIGHT_FLUXES[::2], 1) if run.is_quick else (FLIGHT_FLUXES, FLIGHT_DRAWS)
    views = forest_flights(1 if run.is_quick else FLIGHTS)
    frames = sum(view.trajectory.frames for view in views.values())
    with progress("Rendering flights", frames, "frame") as advance:
        clips = list(forest_clips(views, run.cache, advance))
    flicker = max(each for _, each in clips)
    drawn = len(views) * draws * len(fluxes)
    with progress("Estimating the camera's motion", drawn, "draw") as advance:
        flights = zip(views.values(), clips, strict=True)
        errors = [flight_errors(view, clip, fluxes, draws, advance) for view, (clip, _) in flights]
    board = together(errors)
    rows, columns = clips[0][0].light.shape[1:]
    rate, windows = board[0].rms_yaw_deg, len(board[0].yaw_deg)
    told = (rate, windows, len(views), draws, columns, rows, 100 * flicker)
    return Figure(
        name="camera-motion",
        title="Errors of the camera's own motion in forests with parallax",
        caption=_CAPTION.format(*told),
        draw=partial(_draw, board=board),
        numbers=columns_of(row for each in board for row in _rows(each)),
        height_in=4.2,
        printed={each.name: _reach(each) for each in board},
        printed_by=(f"Yaw within {100 * _YAW:g} %", f"Heading within {_HEADING_DEG:g}°"),
    )


def _rows(errors: MotionErrors) -> list[Mapping[str, Cell]]:
    yaw, heading = errors.intervals()
    columns = {
        "photons_per_px": errors.fluxes,
        "yaw_error": errors.yaw,
        "yaw_low": yaw[0],
        "yaw_high": yaw[1],
        "heading_error_deg": errors.heading,
        "heading_low_deg": heading[0],
        "heading_high_deg": heading[1],
    }
    return [
        {"way": errors.name, **{name: float(each[place]) for name, each in columns.items()}}
        for place in range(len(errors.fluxes))
    ]


def _reach(errors: MotionErrors) -> tuple[str, str]:
    """Return the light from which on each error is small."""
    yaw = _light_for(errors.fluxes, errors.yaw, _YAW)
    if np.isnan(errors.heading).all():
        return yaw, UNDEFINED
    return yaw, _light_for(errors.fluxes, errors.heading, _HEADING_DEG)


def _light_for(fluxes: Sequence[float], errors: Floats, level: float) -> str:
    within = errors <= level
    if not within[-1]:
        return f"none up to {fluxes[-1]:g} photons"
    first = len(within) - int(np.argmin(within[::-1])) if not within.all() else 0
    return f"from {fluxes[first]:g} photons/px on"


def _draw(canvas: Canvas, board: Sequence[MotionErrors]) -> None:
    """Draw a panel of the yaw rate and one of the heading, and their legend below."""
    grid = canvas.add_gridspec(2, 2, height_ratios=(1, 0.3))
    panels = [canvas.add_subplot(grid[0, column]) for column in range(2)]
    for each in board:
        look, (yaw, heading) = _style(each.name), each.intervals()
        draw_interval(panels[0], each.fluxes, 100 * each.yaw, 100 * yaw, **look)
        if np.isfinite(each.heading).any():
            draw_interval(panels[1], each.fluxes, each.heading, heading, **look)
    levels, titles = (100 * _YAW, _HEADING_DEG), ("Yaw rate (%)", "Heading (°)")
    for axes, level, title in zip(panels, levels, titles, strict=True):
        axes.axhline(level, color=GRAY, linestyle=":")
        axes.set(title=title, xscale="log", yscale="log", xlabel="Photons per pixel and frame")
    panels[0].set_ylabel("Error")
    legend_alone(canvas.add_subplot(grid[1, :]), panels[0], ncols=3, columnspacing=1)


def _style(name: str) -> dict[str, Any]:
    """Return the look of a way: that of its method, dashed by what is made of it, or black."""
    method, _, how = name.partition(", ")
    look = {"color": BLACK, "marker": "o" if name.endswith("8 frames") else "s"}
    if how:
        look = method_style(method.partition(" ")[0])
        look["linestyle"] = ":" if how == "summed" else "--"
    return {"label": name, "elinewidth": 0.8, **look}


RECIPES = (FigureRecipe("camera-motion", camera_motion),)
