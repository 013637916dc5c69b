"""Velocities on whole frames, and camera motion in forests, by photons per pixel.

Unlike on the leaderboard of isolated blocks, methods see everything around a block, motion varies
from place to place, and it has edges.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Canvas

from megalopta.benchmark.clips import FlowClip, leaves_clips, panorama_clips
from megalopta.benchmark.flights import (
    FLIGHT_DRAWS,
    FLIGHT_FLUXES,
    FlightErrors,
    flight_errors,
    together,
)
from megalopta.benchmark.methods import BLOCK_PX, methods_and_baselines
from megalopta.benchmark.moving_forests import FLIGHTS, MOVING_VIEWS, forest_clips, forest_flights
from megalopta.benchmark.panoramas import natural_templates
from megalopta.benchmark.table import Interval
from megalopta.benchmark.whole_frames import (
    MEDIAN,
    METRICS,
    PHOTONS_PER_PX,
    Board,
    frame_errors,
)
from megalopta.core.arrays import Floats
from megalopta.core.progress import progress
from megalopta.flow.detectors.blocks import BlockDetector
from megalopta.flow.detectors.registry import Method
from megalopta.plotting.picture import Cell, Figure, columns_of
from megalopta.plotting.style import BLACK, GRAY, draw_interval, legend_alone, method_style
from megalopta.plotting.text import UNDEFINED
from megalopta.reproduction.drawing import FigureRecipe, Run

_LEAVES, _PANORAMAS = "Dead leaves, four motions", "Forests, a turning camera"
_PARALLAX = "Forests, a flying camera"
_DRAWS = {_LEAVES: 1, _PANORAMAS: 1, _PARALLAX: 3}
"""Photon draws of each scene: there are few flights"""

_FRAMES, _PAIR = 8, 2
_CAPTION = (
    "Methods see whole frames of {} px, of {} scenes; curves are means over scenes of the median "
    f"endpoint error of blocks of {BLOCK_PX} × {BLOCK_PX} px against their true mean velocity, "
    "with 95 % CI over scenes. A median says nothing about the worse half: the "
    "CSV and JSON files have means, shares of outliers and more. "
    "On dead leaves the velocity is affine and differs in three disks; forests "
    "are panoramas seen by a rotating camera{}; tuned: with settings for each light, from other "
    "scenes; 4+4: on sums of four frames."
)
_FLOWN = (
    ", or rendered with parallax ({} photon draws each), with up to {:.1f} % of rendering noise "
    "that changes from frame to frame"
)


def whole_frames(run: Run, methods: Sequence[Method] | None = None) -> Figure:
    """Draw median endpoint errors on dead leaves and in forests; fewer scenes in quick form.

    Forests with a flying camera take minutes to render and are not part of the quick form.
    """
    clips, flicker = _clips(run)
    chosen = methods or methods_and_baselines(_FRAMES)
    fluxes = PHOTONS_PER_PX[::2] if run.is_quick else PHOTONS_PER_PX
    with progress("Measuring whole frames", sum(map(len, clips.values())), "scene") as advance:
        boards = {
            kind: frame_errors(some, chosen, fluxes, _DRAWS[kind], advance)
            for kind, some in clips.items()
        }
    number = ", ".join(str(len(some)) for some in clips.values())
    flown = _FLOWN.format(_DRAWS[_PARALLAX], 100 * flicker) if flicker else ""
    size = " × ".join(map(str, clips[_LEAVES][0].light.shape[1:]))
    return Figure(
        name="whole-frames",
        title="Median errors of velocity methods on whole frames, by photons per pixel",
        caption=_CAPTION.format(size, number, flown),
        draw=partial(_draw_boards, boards=boards),
        numbers=columns_of(row for kind, board in boards.items() for row in _rows(kind, board)),
        height_in=2 + 3.3 * len(boards),
        details={"least_median_error": [row for each in boards.items() for row in _best(*each)]},
    )


def _clips(run: Run) -> tuple[dict[str, list[FlowClip]], float]:
    """Return the scenes of each kind, and the largest flicker of a pixel."""
    templates = natural_templates(run.cache)
    if run.is_quick:
        few = dict(list(templates.items())[:2])
        return {_LEAVES: [*leaves_clips(2)], _PANORAMAS: [*panorama_clips(few, headings=1)]}, 0.0
    with progress("Rendering moving views", len(MOVING_VIEWS) * _FRAMES, "frame") as advance:
        flown = list(forest_clips(cache=run.cache, after_frame=advance))
    clips = {
        _LEAVES: [*leaves_clips(6)],
        _PANORAMAS: [*panorama_clips(templates, headings=2)],
        _PARALLAX: [clip for clip, _ in flown],
    }
    return clips, max(noise for _, noise in flown)


def _rows(kind: str, board: Board) -> list[Mapping[str, Cell]]:
    rows: list[Mapping[str, Cell]] = []
    for each, flux in product(board.detectors, board.fluxes):
        median, low, high = _median(board, each, flux)
        rows.append(
            {
                "scenes": kind,
                "method": each.name,
                "frames": float(each.memory_frames + 1),
                "photons_per_px": flux,
                "median_epe_px": median,
                "low_px": low,
                "high_px": high,
                **{
                    name: board.over_scenes(name, each, flux).value
                    for name in METRICS
                    if name != MEDIAN
                },
            }
        )
    return rows


def _median(board: Board, detector: BlockDetector, flux: float) -> list[float]:
    """Return the mean over scenes of the median over blocks, and its interval; NaN if unknown."""
    return list(np.array(board.over_scenes(MEDIAN, detector, flux), float).tolist())


def _best(kind: str, board: Board) -> Iterator[dict[str, Cell]]:
    """Yield the method of least mean median at each flux, and those that are not surely worse."""
    for frames, some in _by_frames(board).items():
        for flux in board.fluxes if some else ():
            best, *others = sorted(some, key=lambda each: _median(board, each, flux)[0])
            level = [e.name for e in others if not board.is_worse(MEDIAN, e, best, flux)]
            what: dict[str, Cell] = {"scenes": kind, "frames": frames, "photons_per_px": flux}
            yield what | {"method": best.name, "level_with": ", ".join(level)}


def _by_frames(board: Board) -> dict[str, list[BlockDetector]]:
    two = [each for each in board.detectors if each.memory_frames + 1 == _PAIR]
    return {"two frames": two, "eight frames": [e for e in board.detectors if e not in two]}


def _draw_boards(canvas: Canvas, boards: Mapping[str, Board]) -> None:
    """Draw a row of panels per kind of scenes, a column per number of frames."""
    panels = canvas.subplots(
        len(boards) + 1, 2, sharex=True, height_ratios=(*[1] * len(boards), 0.42)
    )
    for row, (kind, board) in zip(panels, boards.items(), strict=False):
        for axes, (frames, some) in zip(row, _by_frames(board).items(), strict=True):
            for each in some:
                found = np.array([_median(board, each, flux) for flux in board.fluxes])
                look = {"label": each.name, "elinewidth": 0.8, **method_style(each.name)}
                draw_interval(axes, board.fluxes, found[:, 0], found[:, 1:].T, **look)
            axes.set(title=f"{kind},\n{frames}", xscale="log", yscale="log")
        row[0].set_ylabel("Median endpoint error (px)")
    for axes, above, labeled in zip(panels[-1], panels[0], panels[-2], strict=True):
        labeled.set_xlabel("Photons per pixel and frame")
        labeled.xaxis.set_tick_params(labelbottom=True)
        legend_alone(axes, above, ncols=3, columnspacing=1, markerscale=0.7)


_YAW, _HEADING_DEG = 0.05, 5.0
_MOTION_CAPTION = (
    "RMS error of the yaw rate relative to its RMS ({:.2f}° per frame), and median error of the "
    "heading, in {} windows of eight frames of {} flights, {} photon draws each ({} × {} px, "
    "flicker of a pixel by rendering {:.0f} %); whiskers: 95 % CI over windows. "
    "Summed: responses with weights learned from a flight's noise-free first half, averaged over "
    "seven pairs; fitted: the motion that best fits the flow of blocks; likelihood: the motion of "
    "maximum likelihood of the counts. Only sums learn from these forests. Only the camera moves: "
    "moving objects would mislead all estimators."
)


def camera_motion(run: Run) -> Figure:
    """Draw yaw rate and heading by likelihood, from flow, and from weighted sums of responses."""
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
        title="Errors of camera motion in forests with parallax",
        caption=_MOTION_CAPTION.format(
            board.rms_yaw_deg, windows, len(views), draws, columns, rows, 100 * flicker
        ),
        draw=partial(_draw, board=board),
        numbers=columns_of(_motion_row(board, *each) for each in product(board.ways, board.fluxes)),
        height_in=4.2,
        printed={way: _reach(board, way) for way in board.ways},
        printed_by=(f"Yaw within {100 * _YAW:g} %", f"Heading within {_HEADING_DEG:g}°"),
    )


def _motion_row(board: FlightErrors, way: str, flux: float) -> Mapping[str, Cell]:
    yaw, heading = board.yaw(way, flux), board.heading(way, flux) or (None,) * 3
    names = (
        *("photons_per_px", "yaw_error", "yaw_low", "yaw_high"),
        *("heading_error_deg", "heading_low_deg", "heading_high_deg"),
    )
    numbers = np.array((flux, *yaw, *heading), float).tolist()
    return {"way": way, **dict(zip(names, numbers, strict=True))}


def _reach(board: FlightErrors, way: str) -> tuple[str, str]:
    """Return the light from which each error is small."""
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
    """Return values and their intervals, (2, fluxes)."""
    middle, *ends = np.array(found, float).T
    return middle, np.array(ends)


def _style(name: str) -> Mapping[str, Any]:
    """Return the style of an estimator: its method's, dashed by kind, or black."""
    method, _, how = name.partition(", ")
    if how:
        dash = ":" if how == "summed" else "--"
        look = {**method_style(method.partition(" ")[0]), "linestyle": dash}
    else:
        look = {"color": BLACK, "marker": "o" if name.endswith("8 frames") else "s"}
    return {"elinewidth": 0.8, **look}


RECIPES = (
    FigureRecipe("whole-frames", whole_frames),
    FigureRecipe("camera-motion", camera_motion),
)
