"""The board of whole frames: error of all velocity methods over the photons per pixel.

Unlike the leaderboard of isolated blocks, methods see all that is around a block, motion differs
from place to place, and it has edges.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import product

import numpy as np
from matplotlib.figure import Figure as Canvas

from megalopta.benchmark.clips import FlowClip, leaves_clips, panorama_clips
from megalopta.benchmark.methods import BLOCK_PX, methods_and_baselines
from megalopta.benchmark.moving_forests import MOVING_VIEWS, forest_clips
from megalopta.benchmark.panoramas import natural_templates
from megalopta.benchmark.whole_frames import (
    FAR,
    FAR_PX,
    MEAN,
    MEDIAN,
    PHOTONS_PER_PX,
    Board,
    frame_errors,
)
from megalopta.core.progress import progress
from megalopta.flow.detectors.blocks import BlockDetector
from megalopta.flow.detectors.registry import Method
from megalopta.plotting.picture import Cell, Figure, columns_of
from megalopta.plotting.style import draw_interval, legend_alone, method_style
from megalopta.reproduction.drawing import FigureRecipe, Run

_LEAVES, _PANORAMAS = "Dead leaves, four motions", "Forests, a turning camera"
_PARALLAX = "Forests, a flying camera"
_DRAWS = {_LEAVES: 1, _PANORAMAS: 1, _PARALLAX: 3}
"""Of the photons of each scene: there are few flights"""

_FRAMES, _PAIR = 8, 2
_CAPTION = (
    "Methods see frames of {} px, of {} scenes, as they are; drawn is the mean over scenes of the "
    f"median over blocks of {BLOCK_PX} × {BLOCK_PX} px of the distance from their true mean "
    "velocity, with what holds it in 95 % of bootstraps over scenes. A median does not tell how "
    "far off the worse half is: the mean over blocks and the share beyond "
    f"{FAR_PX:g} px stand in the file of numbers. On dead leaves the velocity is affine and "
    "differs in three disks; forests are panoramas seen by a camera that only turns{}; √ is a "
    "method that sees roots of counts, 4+4 one that sees sums of four frames."
)
_FLOWN = (
    ", or rendered with parallax ({} draws of photons each), where up to {:.1f} % of a pixel "
    "flickers"
)


def whole_frames(run: Run, methods: Sequence[Method] | None = None) -> Figure:
    """Return median endpoint errors on dead leaves and in forests; in quick form of fewer scenes.

    Forests past which a camera flies take minutes to render, so that quick form is without.
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
        title="Median errors of velocity methods on whole frames, over the photons per pixel",
        caption=_CAPTION.format(size, number, flown),
        draw=partial(_draw_boards, boards=boards),
        numbers=columns_of(row for kind, board in boards.items() for row in _rows(kind, board)),
        height_in=2 + 3.3 * len(boards),
        details={"least_median_error": [row for each in boards.items() for row in _best(*each)]},
    )


def _clips(run: Run) -> tuple[dict[str, list[FlowClip]], float]:
    """Return the scenes of each kind, and by which share a pixel flickers at most."""
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
                "mean_epe_px": board.over_scenes(MEAN, each, flux).value,
                "share_beyond_3_px": board.over_scenes(FAR, each, flux).value,
            }
        )
    return rows


def _median(board: Board, detector: BlockDetector, flux: float) -> tuple[float, float, float]:
    """Return the mean over scenes of the median over blocks, and its interval."""
    value, low, high = board.over_scenes(MEDIAN, detector, flux)
    return value, math.nan if low is None else low, math.nan if high is None else high


def _best(kind: str, board: Board) -> Iterator[dict[str, Cell]]:
    """Yield which has the least mean of medians at each flux, and whose intervals reach it."""
    for frames, some in _by_frames(board).items():
        for flux in board.fluxes if some else ():
            found = {each.name: _median(board, each, flux) for each in some}
            best, *others = sorted(found, key=lambda name: found[name][0])
            level = ", ".join(name for name in others if found[name][1] <= found[best][2])
            what: dict[str, Cell] = {"scenes": kind, "frames": frames, "photons_per_px": flux}
            yield what | {"method": best, "level_with": level}


def _by_frames(board: Board) -> dict[str, list[BlockDetector]]:
    two = [each for each in board.detectors if each.memory_frames + 1 == _PAIR]
    return {"two frames": two, "eight frames": [e for e in board.detectors if e not in two]}


def _draw_boards(canvas: Canvas, boards: Mapping[str, Board]) -> None:
    """Draw a row of panels for each kind of scenes, a column for each number of frames."""
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


RECIPES = (FigureRecipe("whole-frames", whole_frames),)
