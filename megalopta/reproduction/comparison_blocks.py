"""Leaderboard of velocity methods, limit of Poisson matching, and detection of motion.

All bounds assume no outliers, which no method avoids at few photons. One assumes a known texture;
the other a known power spectrum alone, so that it depends on two or eight frames. Methods may use
the margin of a block, so that the bound of the block alone is not a strict limit; that of block and
margin, in the table of numbers, is. The bound holds for unbiased methods: one that smooths over
neighbors or favors a fixed velocity can exceed an efficiency of 1 and still be wrong.

Textures for the detection of motion have equal contrast in all octaves. Fluxes there exclude dark
counts.
"""

import math
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import EngFormatter, PercentFormatter

from megalopta.benchmark.textures import (
    COLUMNS,
    CONTRAST,
    DARK_COUNTS,
    EFFICIENCY_FLUXES,
    FLUXES,
    GRID,
    LEVEL,
    MARGIN_PX,
    RESPONSES,
    SIZE,
    SPEED_COLUMNS,
    SPEED_PX,
    BlockPhotons,
    Bounds,
    Detection,
    bounds,
    detections,
    efficiencies,
    information,
    ranked,
    sequences,
)
from megalopta.flow.detectors.blocks import BlockDetector
from megalopta.flow.detectors.registry import METHODS, Method, method
from megalopta.flow.metrics.detection import d_prime
from megalopta.flow.metrics.photon_threshold import format_flux
from megalopta.flow.metrics.translation_bound import bound_photons, cramer_rao_covariance_along_x
from megalopta.plotting.picture import Cell, Figure, columns_of
from megalopta.plotting.style import (
    BLACK,
    BLUE,
    GRAY,
    GREEN,
    ORANGE,
    legend_alone,
    method_style,
    write_at,
)
from megalopta.reproduction.drawing import FigureRecipe, Run

OURS = ("PM", "PPM", "PF", "PPF", "PF-fast")
MATCHING = ("PM", "PPM")
DRAWS = 12
_BLOCK, _CUT = (f"{side} × {side} px" for side in (GRID.block_px, GRID.block_px + 2 * MARGIN_PX))
_POOLED_SEQUENCES = 2
"""Fewer sequences suffice with eight frames per draw."""


_EFFICIENCY = (
    f"Dead leaves of 240 × 240 px drift by {SPEED_PX:.2f} px per frame; the efficiency is "
    f"the bound over the variance, both over x and y, of {DRAWS} draws of the photons, in "
    "the median block. Each method is compared with the bound of the frames that it "
    f"sees ({{}}) and of the {_BLOCK} of a block alone, though it sees "
    f"whole frames: the bound of {_CUT} needs "
    "{:.2f} times the photons. The variance excludes "
    "bias, so a biased method can exceed 1 and still be wrong."
)


def leaderboard(_: Run) -> Figure:
    """Draw photons, efficiency and time of every method that gives the velocity of blocks."""
    clean = sequences()
    entries = ranked(clean, METHODS)
    two, eight = bounds(clean, 2), bounds(clean, 8)
    along_x = cramer_rao_covariance_along_x(information(clean))

    return Figure(
        name="leaderboard",
        title="Photons needed to measure the velocity of an isolated block",
        caption=(
            f"In {len(clean)} sequences of dead leaves of 240 × 240 px, which drift by "
            f"{SPEED_PX:.2f} px per frame, each method sees one block of {_BLOCK} with a margin of "
            f"{MARGIN_PX} px and nothing else; on whole frames and photographs, which are not "
            "measured here, the order differs. Beside each bar (whiskers: 95 % CI over textures; "
            f"hatched: never below 25 % up to {format_flux(FLUXES[-1])} photons): photons per "
            "frame, the share of them at the bound of as many frames with known texture (green: "
            "only its power spectrum is known), and CPU time per frame. "
            f"{frames_collected(entries)}"
        ),
        draw=lambda canvas: _draw_board(canvas.subplots(), entries, two, eight),
        numbers=columns_of(_row(each, two.known) for each in entries),
        height_in=1.1 + 0.36 * len(entries),
        details={
            "bounds": {
                "two_frames": two.known,
                "eight_frames": eight.known,
                "two_frames_unknown_texture": two.unknown,
                "eight_frames_unknown_texture": eight.unknown,
                "two_frames_along_x_with_y_known": bound_photons(along_x, SPEED_PX, LEVEL),
                "two_frames_block_and_margin": two.with_margin,
                "eight_frames_block_and_margin": eight.with_margin,
            }
        },
    )


def _row(entry: BlockPhotons, two_frame_bound: float) -> dict[str, Cell]:
    return {
        "method": entry.detector.name,
        "label": entry.detector.label,
        "frames": float(entry.frames),
        "photons_per_frame": entry.needed.photons,
        "photons_in_all_frames": entry.frames * entry.needed.photons,
        "low": entry.needed.low,
        "high": entry.needed.high,
        "bound_photons_per_frame": entry.bounds.known,
        "block_and_margin_bound_photons_per_frame": entry.bounds.with_margin,
        "unknown_texture_bound_photons_per_frame": entry.bounds.unknown,
        "efficiency": entry.efficiency,
        "photons_over_two_frame_bound": entry.needed.photons / two_frame_bound,
        "cpu_ms_per_frame": entry.ms_per_frame,
    }


def frames_collected(entries: Sequence[BlockPhotons]) -> str:
    """Return a sentence on methods that see more than two frames."""
    many = []
    for each in entries:
        if each.frames > 2:
            flux = each.frames * each.needed.photons
            total = f" ({format_flux(flux)} photons in total)" if math.isfinite(flux) else ""
            many.append(f"{each.detector.label} {each.frames}{total}")
    return (
        f"Methods see two frames, but {', '.join(many)}." if many else "All methods see two frames."
    )


def efficiency(_: Run) -> Figure:
    """Draw bound over variance of Poisson matching in two and in eight frames, over the flux."""
    clean = sequences()
    curves, two = {}, bounds(clean, 2)
    for name in MATCHING:
        detector = METHODS[name]
        assert isinstance(detector, BlockDetector)
        few = clean if detector.memory_frames == 1 else clean[:_POOLED_SEQUENCES]
        curves[name] = efficiencies(few, detector, EFFICIENCY_FLUXES, DRAWS)

    methods = (METHODS[name] for name in MATCHING)
    seen = ", ".join(f"{each.label} {each.memory_frames + 1}" for each in methods)
    return Figure(
        name="efficiency",
        title="Variance of Poisson matching against the Poisson bound",
        caption=_EFFICIENCY.format(seen, two.with_margin / two.known),
        draw=partial(_draw_efficiency, curves=curves),
        numbers={
            "photons_per_frame": EFFICIENCY_FLUXES,
            **{f"{name}_efficiency": values for name, values in curves.items()},
        },
    )


def _draw_efficiency(canvas: Canvas, curves: Mapping[str, Sequence[float]]) -> None:
    axes = canvas.subplots()
    for name, values in curves.items():
        label = METHODS[name].label
        axes.semilogx(EFFICIENCY_FLUXES, values, label=label, **method_style(name))
    axes.axhline(0.5, color=GRAY, linestyle=":")
    left = EFFICIENCY_FLUXES[0], 0.5
    write_at(axes, "variance twice the bound", left, (2, 4), color=BLACK, fontsize=9.5)
    axes.set(xlabel="Photons per frame", ylabel="Efficiency (bound / variance)", ylim=(0, 1.05))
    axes.legend(loc="lower right")


def _draw_board(
    axes: Axes,
    entries: Sequence[BlockPhotons],
    two: Bounds,
    eight: Bounds,
) -> None:
    """Draw a bar per method, and the bounds of two and eight frames."""
    for place, entry in enumerate(entries):
        _draw_entry(axes, entry, place)
    for color, texture in ((ORANGE, "known"), (GREEN, "unknown")):
        for frames, found, dash in ((2, two, "--"), (8, eight, ":")):
            label = f"bound, texture {texture}, {frames} frames"
            axes.axvline(getattr(found, texture), color=color, linestyle=dash, label=label)
    names = [
        each.detector.label + (f",\n{each.frames} frames" if each.frames > 2 else "")
        for each in entries
    ]
    lowest = min(two.known, eight.known, FLUXES[0])
    axes.set(xscale="log", xlim=(lowest / 1.6, 40 * FLUXES[-1]))
    axes.set_xticks(10.0 ** np.arange(3, round(math.log10(FLUXES[-1])) + 1))
    axes.minorticks_off()
    axes.set_yticks(range(len(entries)), names)
    axes.set_ylim(len(entries) - 0.4, -2.3)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("Photons per frame for a median error of 25 %")
    axes.legend(loc="upper right", ncols=2, frameon=True, framealpha=1, edgecolor="none")


def _draw_entry(axes: Axes, entry: BlockPhotons, place: int) -> None:
    color = BLUE if entry.detector.name in OURS else GRAY
    end = FLUXES[-1]
    if math.isfinite(entry.needed.photons):
        end = min(entry.needed.high, FLUXES[-1])
        axes.barh(place, entry.needed.photons, height=0.62, color=color, edgecolor=color)
        axes.plot([entry.needed.low, end], [place, place], "|-", color=BLACK, linewidth=1.2)
        end = max(entry.needed.photons, end)
    else:
        axes.barh(place, end, height=0.62, color="none", edgecolor=color, hatch="///")
    pad = {"color": "white", "pad": 0.5}
    write_at(axes, _beside(entry), (end, place), (5, 0), va="center", fontsize=9.5, bbox=pad)


def _beside(entry: BlockPhotons) -> str:
    time = f"{float(f'{entry.ms_per_frame:.2g}'):g} ms"
    if not math.isfinite(entry.needed.photons):
        return f"never · {time}"
    photons = EngFormatter(sep="")(float(f"{entry.needed.photons:.2g}"))
    return f"{photons} · {100 * entry.efficiency:.2g} % · {time}"


DETECTION_FLUXES = tuple(10 ** (half / 2) for half in range(5, 14))
ROC_FLUX = 3e4
_CAPTION = (
    f"Textures of {100 * CONTRAST:g} % rms contrast move by {SPEED_COLUMNS * SIZE / COLUMNS:.2f} "
    f"px per frame, with {DARK_COUNTS:.2f} dark counts per pixel; each block of {SIZE // 10} × "
    f"{SIZE // 10} px in frames of {SIZE} × {SIZE} px has one response, a velocity or a mean; PC "
    "has one for the whole frame. d′ is √2·Φ⁻¹(area under the ROC), which "
    f"{RESPONSES:,} responses limit to {{:.1f}} (dotted); NDM and NDS do not depend on direction. "
    "A false alarm exceeds half of the median noise-free response to motion; the ROC is that at "
    "{} photons per frame."
)


def detection_figure(
    methods: Sequence[Method] | None = None, fluxes: Sequence[float] = DETECTION_FLUXES
) -> Figure:
    """Draw d′ over photons per frame, false alarms, and one ROC, for all methods or some."""
    detectors = [method(each) for each in methods or METHODS if methods or each != "IM"]
    at_flux = [detections(detectors, flux) for flux in fluxes]
    found = dict(zip((each.name for each in detectors), zip(*at_flux, strict=True), strict=True))
    shown = min(fluxes, key=lambda flux: abs(np.log(flux / ROC_FLUX)))

    return Figure(
        name="detection",
        title="Detection of motion and its direction by photons per frame",
        caption=_CAPTION.format(_limit(), format_flux(shown)),
        draw=partial(_draw_panels, found=found, roc_flux=shown),
        numbers=columns_of(
            {
                "method": each.method,
                "photons_per_frame": each.flux,
                "d_prime_motion": each.motion,
                "d_prime_direction": each.direction,
                "false_alarm_rate": each.false_alarms,
            }
            for measured in found.values()
            for each in measured
        ),
        height_in=7.4,
    )


def _limit() -> float:
    return d_prime(np.zeros(RESPONSES), np.ones(RESPONSES))


def _draw_panels(canvas: Canvas, found: Mapping[str, Sequence[Detection]], roc_flux: float) -> None:
    panels = canvas.subplot_mosaic(
        [["motion", "direction"], ["false_alarms", "roc"], ["legend", "legend"]],
        height_ratios=(1, 1, 0.18),
    )
    for field in ("motion", "direction", "false_alarms"):
        for name, measured in found.items():
            values = [getattr(each, field) for each in measured]
            fluxes = [each.flux for each in measured]
            panels[field].plot(fluxes, values, label=name, **method_style(name))
        panels[field].set(xscale="log", xlabel="Photons per frame")
    for field, title in (("motion", "Moving from still"), ("direction", "Right from left")):
        panels[field].axhline(_limit(), color=GRAY, linewidth=1, linestyle=":")
        panels[field].set(title=title, ylabel="d′")
    panels["false_alarms"].set(title="False alarms in a still scene", ylabel="Share of blocks")
    panels["false_alarms"].yaxis.set_major_formatter(PercentFormatter(1))
    _draw_roc(panels["roc"], found, roc_flux)
    look = {"ncols": 6, "handlelength": 2.8, "columnspacing": 1.1, "markerscale": 0.8}
    legend_alone(panels["legend"], panels["motion"], **look)


def _draw_roc(axes: Axes, found: Mapping[str, Sequence[Detection]], flux: float) -> None:
    for name, measured in found.items():
        curve = next(each.curve for each in measured if each.flux == flux)
        style = method_style(name) | {"marker": ""}
        axes.plot(curve.false_alarms, curve.hits, **style)
    axes.plot([0, 1], [0, 1], color=GRAY, linewidth=1, linestyle=":")
    axes.set(title="ROC, moving from still", xlabel="False alarms", ylabel="Hits")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(PercentFormatter(1))


RECIPES = (
    FigureRecipe("leaderboard", leaderboard),
    FigureRecipe("efficiency", efficiency),
    FigureRecipe("detection", lambda _: detection_figure()),
)
