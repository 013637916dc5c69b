"""How well the camera's own motion is estimated in forests, over the photons per pixel."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Canvas

from megalopta.benchmark.flights import (
    FLIGHT_DRAWS,
    FLIGHT_FLUXES,
    FlightErrors,
    flight_errors,
    together,
)
from megalopta.benchmark.moving_forests import FLIGHTS, forest_clips, forest_flights
from megalopta.benchmark.table import Interval
from megalopta.core.arrays import Floats
from megalopta.core.progress import progress
from megalopta.plotting.picture import Cell, Figure, columns_of
from megalopta.plotting.style import BLACK, GRAY, draw_interval, legend_alone, method_style
from megalopta.plotting.text import UNDEFINED
from megalopta.reproduction.drawing import FigureRecipe, Run

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
        board = together(
            [
                flight_errors(view, clip, fluxes, draws, advance)
                for view, (clip, _) in zip(views.values(), clips, strict=True)
            ]
        )
    rows, columns = clips[0][0].light.shape[1:]
    windows = len(board.true_yaw_deg)
    return Figure(
        name="camera-motion",
        title="Errors of the camera's own motion in forests with parallax",
        caption=_CAPTION.format(
            board.rms_yaw_deg, windows, len(views), draws, columns, rows, 100 * flicker
        ),
        draw=partial(_draw, board=board),
        numbers=columns_of(_row(board, *each) for each in product(board.ways, board.fluxes)),
        height_in=4.2,
        printed={way: _reach(board, way) for way in board.ways},
        printed_by=(f"Yaw within {100 * _YAW:g} %", f"Heading within {_HEADING_DEG:g}°"),
    )


def _row(board: FlightErrors, way: str, flux: float) -> Mapping[str, Cell]:
    yaw, heading = board.yaw(way, flux), board.heading(way, flux) or (None,) * 3
    names = (
        "photons_per_px",
        *("yaw_error", "yaw_low", "yaw_high"),
        *("heading_error_deg", "heading_low_deg", "heading_high_deg"),
    )
    numbers = (math.nan if each is None else each for each in (flux, *yaw, *heading))
    return {"way": way, **dict(zip(names, numbers, strict=True))}


def _reach(board: FlightErrors, way: str) -> tuple[str, str]:
    """Return the light from which on each error is small."""
    fluxes = board.fluxes
    yaw = _light_for(fluxes, [board.yaw(way, flux).value for flux in fluxes], _YAW)
    headings = [found.value for flux in fluxes if (found := board.heading(way, flux))]
    return yaw, _light_for(fluxes, headings, _HEADING_DEG) if headings else UNDEFINED


def _light_for(fluxes: Sequence[float], errors: Sequence[float], level: float) -> str:
    within = np.array(errors) <= level
    if not within[-1]:
        return f"none up to {fluxes[-1]:g} photons"
    first = len(within) - int(np.argmin(within[::-1])) if not within.all() else 0
    return f"from {fluxes[first]:g} photons/px on"


def _draw(canvas: Canvas, board: FlightErrors) -> None:
    """Draw a panel of the yaw rate and one of the heading, and their legend below."""
    grid = canvas.add_gridspec(2, 2, height_ratios=(1, 0.3))
    panels = [canvas.add_subplot(grid[0, column]) for column in range(2)]
    for way in board.ways:
        yaw = [board.yaw(way, flux) for flux in board.fluxes]
        heading = [found for flux in board.fluxes if (found := board.heading(way, flux))]
        middle, ends = _parts(yaw)
        draw_interval(panels[0], board.fluxes, 100 * middle, 100 * ends, label=way, **_style(way))
        if heading:
            draw_interval(panels[1], board.fluxes, *_parts(heading), label=way, **_style(way))
    levels, titles = (100 * _YAW, _HEADING_DEG), ("Yaw rate (%)", "Heading (°)")
    for axes, level, title in zip(panels, levels, titles, strict=True):
        axes.axhline(level, color=GRAY, linestyle=":")
        axes.set(title=title, xscale="log", yscale="log", xlabel="Photons per pixel and frame")
    panels[0].set_ylabel("Error")
    legend_alone(canvas.add_subplot(grid[1, :]), panels[0], ncols=3, columnspacing=1)


def _parts(found: Sequence[Interval]) -> tuple[Floats, Floats]:
    """Return values, and what holds them, (2, fluxes)."""
    middle, *ends = np.array(found, float).T
    return middle, np.array(ends)


def _style(name: str) -> Mapping[str, Any]:
    """Return the look of a way: that of its method, dashed by what is made of it, or black."""
    method, _, how = name.partition(", ")
    if how:
        dash = ":" if how == "summed" else "--"
        look = {**method_style(method.partition(" ")[0]), "linestyle": dash}
    else:
        look = {"color": BLACK, "marker": "o" if name.endswith("8 frames") else "s"}
    return {"elinewidth": 0.8, **look}


RECIPES = (FigureRecipe("camera-motion", camera_motion),)
