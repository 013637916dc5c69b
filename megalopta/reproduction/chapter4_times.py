"""Computing time per frame of each method, measured here and now, beside §4.6.4."""

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure as Canvas

from megalopta.benchmark.templates import GratingTemplate
from megalopta.flow.detectors.base import milliseconds_per_frame
from megalopta.flow.detectors.registry import METHODS
from megalopta.flow.stimuli.moving_template import MovingTemplate
from megalopta.flow.stimuli.photons import Counts, draw_counts
from megalopta.plotting.picture import Figure
from megalopta.plotting.style import draw_table
from megalopta.reproduction.figure_recipe import FigureRecipe, Run

SIZES = (60, 240)
PRINTED_MS: Mapping[str, tuple[str, str]] = {
    "BM": ("17", "338"),
    "IIA": ("6", "9"),
    "EMD": ("< 0.3", "< 3"),
    "NDM": ("< 0.3", "< 3"),
    "NDS": ("< 0.3", "< 3"),
}
"""MATLAB, Intel Core i5-5300U at 2.3 GHz, for 60 × 60 and 240 × 240 px."""
WIDTHS = (0.7, 1.2, 0.9, 0.9, 1.3, 0.9, 0.9)
_FRAMES = 16
_PHOTONS_PER_PIXEL = 10.0


def _counts(size: int) -> Counts:
    light = MovingTemplate(GratingTemplate().pixels(), 5, size).light(0, _FRAMES)
    return draw_counts(light * _PHOTONS_PER_PIXEL * size**2, 0, "times")


def _figure(run: Run) -> Figure:
    counts = [_counts(size) for size in SIZES]
    times = {
        name: [milliseconds_per_frame(METHODS[name], each) for each in counts]
        for name in PRINTED_MS
    }

    def draw(canvas: Canvas) -> None:
        head = [text for size in SIZES for text in (f"Thesis, {size}²", "Ours", "Faster")]
        draw_table(canvas, ["", *head], [_line(*each) for each in times.items()], WIDTHS)

    return Figure(
        title="Computing time per frame (ms), beside that of §4.6.4",
        caption="Ours is the CPU time on this machine of a frame whose predecessors are known, the "
        "median of three runs, from counts of 10 photons per pixel to responses. The dissertation "
        "used MATLAB on an Intel Core i5-5300U at 2.3 GHz.",
        draw=draw,
        numbers={
            "method": list(times),
            **{
                f"time_{size}_ms": [spent[place] for spent in times.values()]
                for place, size in enumerate(SIZES)
            },
        },
        height_in=2.0,
    )


def _line(name: str, spent: Sequence[float]) -> list[str]:
    line = [name]
    for printed, ours in zip(PRINTED_MS[name], spent, strict=True):
        factor = float(printed.removeprefix("< ")) / ours
        line += [printed, f"{ours:.2g}", f"{'< ' if printed[0] == '<' else ''}{factor:.0f} ×"]
    return line


RECIPES = (FigureRecipe("table-4.times", _figure),)
