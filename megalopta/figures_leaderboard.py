"""The leaderboard of all velocity methods, and how near the two made for it come to the limit."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import EngFormatter

from megalopta.figure import Figure, Registry
from megalopta.flow.block_detector import BlockDetector
from megalopta.flow.methods import METHODS
from megalopta.flow.threshold import format_flux
from megalopta.leaderboard import (
    EFFICIENCY_FLUXES,
    FLUXES,
    GRID,
    MARGIN_PX,
    SPEED_PX,
    Entry,
    bound,
    bound_along_x,
    efficiencies,
    information,
    ranked,
    sequences,
)
from megalopta.plot_style import BLACK, BLUE, GRAY, ORANGE, method_style

OURS = ("PM", "PPM")
DRAWS = 12
_BLOCK, _CUT = (f"{side} × {side} px" for side in (GRID.block_px, GRID.block_px + 2 * MARGIN_PX))
_POOLED_SEQUENCES = 2
"""Eight frames a draw: fewer sequences do."""


def leaderboard() -> Figure:
    """Photons, efficiency and time of every method that gives the velocity of blocks."""
    clean = sequences()
    known, seen = information(clean), information(clean, MARGIN_PX)
    entries = ranked(clean, METHODS)
    two, eight = bound(known, 2), bound(known, 8)

    return Figure(
        name="leaderboard",
        title="Photons that a velocity takes, every method on the same pixels",
        caption=(
            f"Dead leaves that drift by {SPEED_PX:.2f} px/frame, 240 × 240 px (area), "
            f"{len(clean)} sequences of 64 blocks. Each method sees one block of {_BLOCK} with a "
            f"margin of {MARGIN_PX} px, {_CUT}, and nothing else of the frame; error is the length "
            "of the difference from the true velocity. Whiskers hold 95 % of bootstraps over the "
            "sequences. Beside each bar: photons, efficiency (photons that the Poisson bound of so "
            "many frames needs, over photons needed), CPU time of one 240 × 240 frame in this run. "
            f"The bound counts the photons of the {_BLOCK} alone, for x and y together: "
            f"{format_flux(two)} with two frames, {format_flux(eight)} with eight; for x alone, "
            f"were y known, {format_flux(bound_along_x(known))}. Methods may draw on the margin, "
            f"so it does not limit them strictly; that of all {_CUT} is "
            f"{format_flux(bound(seen, 2))} and {format_flux(bound(seen, 8))}. Both take the "
            "texture as known and no block as mistaken, which no method can at few photons. "
            f"Hatched: never below 25 % up to {format_flux(FLUXES[-1])} photons."
        ),
        draw=lambda canvas: _draw_board(canvas.subplots(), entries, {2: two, 8: eight}),
        columns=(
            "method",
            "label",
            "frames",
            "photons_per_frame",
            "low",
            "high",
            "bound_photons_per_frame",
            "block_and_margin_bound_photons_per_frame",
            "efficiency",
            "photons_over_two_frame_bound",
            "cpu_ms_per_frame",
        ),
        rows=tuple(
            (
                each.detector.name,
                each.detector.label,
                float(each.frames),
                each.photons,
                each.low,
                each.high,
                each.bound_photons,
                each.cut_bound_photons,
                each.efficiency,
                each.photons / two,
                each.ms_per_frame,
            )
            for each in entries
        ),
        height_in=0.8 + 0.36 * len(entries),
    )


def efficiency() -> Figure:
    """Bound over variance of the two methods that aim at the limit, against the flux."""
    clean = sequences()
    known, seen = information(clean), information(clean, MARGIN_PX)
    curves = {}
    for name in OURS:
        detector = METHODS[name]
        assert isinstance(detector, BlockDetector)
        few = clean if detector.memory_frames == 1 else clean[:_POOLED_SEQUENCES]
        curves[name] = efficiencies(few, detector, EFFICIENCY_FLUXES, DRAWS)

    def draw(canvas: Canvas) -> None:
        axes = canvas.subplots()
        for name, values in curves.items():
            axes.semilogx(
                EFFICIENCY_FLUXES,
                values,
                label=METHODS[name].label,
                **method_style(name),
            )
        axes.axhline(0.5, color=GRAY, linestyle=":")
        axes.annotate(
            "variance twice the bound",
            (EFFICIENCY_FLUXES[0], 0.5),
            xytext=(2, 4),
            textcoords="offset points",
            color=BLACK,
            fontsize=9.5,
        )
        axes.set_ylim(0, 1.05)
        axes.set_xlabel("Photons per frame")
        axes.set_ylabel("Efficiency (bound / variance)")
        axes.legend(loc="lower right")

    return Figure(
        name="efficiency",
        title="Variance of our two methods against the Poisson bound",
        caption=(
            f"Dead leaves, {SPEED_PX:.2f} px/frame, 240 × 240 px. Bound over variance, both over x "
            f"and y, for each block over {DRAWS} draws of the photons; median of the blocks. Each "
            "method is held against the bound of the frames that it uses, two and eight, and of "
            f"the {_BLOCK} of a block alone, though frames are seen whole and the search reaches "
            f"beyond the block: the bound of {_CUT}, block and margin, asks for "
            f"{bound(seen, 2) / bound(known, 2):.2f} times the photons. Variance leaves out bias, "
            f"{DRAWS} draws make the median some 3 % too high, "
            "and the bound holds for unbiased methods: one that smooths over its neighbors or "
            "leans toward a fixed answer can exceed 1 and still be wrong."
        ),
        draw=draw,
        columns=("photons_per_frame", *(f"{name}_efficiency" for name in curves)),
        rows=tuple(zip(EFFICIENCY_FLUXES, *curves.values(), strict=True)),
    )


def _draw_board(axes: Axes, entries: Sequence[Entry], bounds: Mapping[int, float]) -> None:
    """Draw a bar for each method, and the bounds of two and eight frames."""
    for place, entry in enumerate(entries):
        needed = entry.photons if math.isfinite(entry.photons) else FLUXES[-1]
        color = BLUE if entry.detector.name in OURS else GRAY
        hatch = None if math.isfinite(entry.photons) else "///"
        axes.barh(
            place,
            needed,
            height=0.62,
            color=color if hatch is None else "none",
            edgecolor=color,
            hatch=hatch,
        )
        high = min(entry.high, FLUXES[-1])
        if hatch is None:
            axes.plot([entry.low, high], [place, place], "|-", color=BLACK, linewidth=1.2)
        axes.annotate(
            _beside(entry),
            (max(needed, high), place),
            xytext=(5, 0),
            textcoords="offset points",
            va="center",
            fontsize=9.5,
            bbox={"color": "white", "pad": 0.5},
        )
    for (frames, flux), dash in zip(bounds.items(), ("--", ":"), strict=True):
        axes.axvline(flux, color=ORANGE, linestyle=dash, label=f"bound, {frames} frames")
    axes.set_xscale("log")
    axes.set_xlim(min(*bounds.values(), FLUXES[0]) / 1.6, 40 * FLUXES[-1])
    axes.set_xticks(10.0 ** np.arange(3, round(math.log10(FLUXES[-1])) + 1))
    axes.minorticks_off()
    axes.set_yticks(range(len(entries)), [each.detector.label for each in entries])
    axes.set_ylim(len(entries) - 0.4, -1.6)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("Photons per frame for a median error of 25 %")
    axes.legend(loc="upper right", ncols=2, frameon=True, framealpha=1, edgecolor="none")


def _beside(entry: Entry) -> str:
    time = f"{float(f'{entry.ms_per_frame:.2g}'):g} ms"
    if not math.isfinite(entry.photons):
        return f"never · {time}"
    photons = EngFormatter(sep="")(float(f"{entry.photons:.2g}"))
    return f"{photons} · {100 * entry.efficiency:.2g} % · {time}"


LIMIT: Registry = {"leaderboard": leaderboard, "efficiency": efficiency}
