"""Draw leaderboard.png: photons that each method needs for the velocity of an isolated block.

Dead leaves of 251 rows drift by 3 columns per frame and are resized to 240 × 240 px. Every method
sees each block of 24 × 24 px alone with a margin of 7 px. A method in
`out/pictures/leaderboard.json` is not measured again.

A method that smooths its flow over the frame, uses a pyramid or one velocity for all blocks uses
more photons than those of a block, so each block and its margin is a frame of its own.
"""

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from scipy.special import stdtrit

from megalopta.assets_gen import generator
from megalopta.assets_gen.surface_textures import dead_leaves
from megalopta.core.arrays import Floats, Mask
from megalopta.flow import METHODS, cramer_rao_covariance, fisher_information
from megalopta.flow.detectors.base import Frames
from megalopta.flow.detectors.blocks import BlockDetector, BlockGrid, block_grid
from megalopta.flow.metrics.photon_threshold import first_crossing
from megalopta.flow.metrics.translation_bound import median_endpoint_error
from megalopta.flow.stimuli.moving_template import MovingTemplate
from megalopta.flow.stimuli.photons import draw_counts
from megalopta.report.style import BLACK, NUMBERS, house_style, method_style

_CONFIDENCE = 0.95


class MedianPhotons(NamedTuple):
    """Photons per frame that a method needs, and their 95 % interval; 0 to infinity if unknown."""

    photons: float
    low: float
    high: float


def confined_velocities(
    detector: BlockDetector, frames: Frames, grid: BlockGrid, margin_px: int
) -> Floats:
    """Return the newest velocity of each inner block, from its support alone.

    `detector`: any that gives velocities; its parameters for blocks and search are replaced;
    `frames` (T, H, W): counts; of them, the last `memory_frames` + 1 are used; `grid`: blocks of
    the frames; those at the border are skipped; `margin_px`: from 1 to the side of a block.
    Returns (rows − 2, columns − 2, 2), px per frame.

    Raises ValueError if the margin is out of range.
    """
    if not 1 <= margin_px <= grid.block_px:
        raise ValueError(f"margin_px {margin_px}: give 1 to {grid.block_px}, the side of a block")
    # frames of one block and its margin, all of which are searched
    changes = {"block_px": grid.block_px, "fewest_blocks": 1}
    if "radius_px" in type(detector).model_fields:
        changes["radius_px"] = margin_px
    alone = detector.model_copy(update=changes)
    side = grid.block_px + 2 * margin_px
    newest = frames[-1 - detector.memory_frames :]
    velocities = np.empty((grid.rows - 2, grid.columns - 2, 2))
    for row, column in np.ndindex(velocities.shape[:2]):
        top = grid.top + (row + 1) * grid.block_px - margin_px
        left = grid.left + (column + 1) * grid.block_px - margin_px
        cut = newest[:, top : top + side, left : left + side]
        velocities[row, column] = alone.respond(cut)[-1, 0, 0]
    return velocities


def is_within(velocities: Floats, truth: tuple[float, float], level: float) -> Mask:
    """Return whether |v − truth| < level·|truth| for velocities (..., 2); never where undefined."""
    error = np.hypot(*np.moveaxis(velocities - np.asarray(truth), -1, 0))
    return np.asarray(error < level * np.hypot(*truth))


def photons_for_half(is_good: Callable[[float], Mask], fluxes: Sequence[float]) -> MedianPhotons:
    """Return the flux at which half of the blocks are good: the median error is at its level.

    The crossing is bracketed by bisection, so few of the fluxes are tried. Between them the share
    of good blocks, which also grows smoothly where a method answers in whole pixels and its median
    error falls in steps, is interpolated linearly over log flux: about its half a share is
    straight. The interval has the fluxes at which the share, by its standard error over groups and
    Student's quantiles, may be a half.

    `is_good`: flux to one truth value per block, (groups, ...); the same blocks at each flux.
    Groups are independent of each other, the blocks of one need not be. `fluxes`: growing; two or
    more. Returns infinite when no more than half are good at the largest flux; 0 when more than
    half are at the smallest.
    """
    tried: dict[int, Floats] = {}

    def more_than_half(index: int) -> bool:
        good = is_good(fluxes[index])
        tried[index] = good.reshape(len(good), -1).mean(axis=1)
        return bool(tried[index].mean() > 0.5)

    low, high = 0, len(fluxes) - 1
    if more_than_half(high):
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if more_than_half(middle) else (middle, high)
    if low not in tried:
        more_than_half(low)
    while True:
        at = np.array([fluxes[index] for index in sorted(tried)])
        good = np.array([tried[index] for index in sorted(tried)])
        share, unsure = good.mean(axis=1), _uncertainty(good)
        ends = (float(_half(at, each)) for each in (share, share + unsure, share - unsure))
        needed, lowest = MedianPhotons(*ends), min(tried)
        if needed.low > 0 or lowest == 0 or np.isinf(unsure).any():
            return needed
        more_than_half(lowest - 1)  # the interval reaches below the fluxes tried


def _uncertainty(shares: Floats) -> Floats:
    """Return half of the interval of the mean over groups of shares (n, groups), (n,)."""
    groups = shares.shape[1]
    if groups < 2:
        return np.full(len(shares), np.inf)
    steps = stdtrit(groups - 1, (1 + _CONFIDENCE) / 2)
    return np.asarray(steps * shares.std(axis=1, ddof=1) / math.sqrt(groups))


def _half(fluxes: Floats, shares: Floats) -> Floats:
    # first_crossing is linear in the log of an error: this one's log is the share of bad blocks.
    return first_crossing(fluxes, np.exp(1 - shares), np.exp(0.5))


def bound_photons(covariances: Floats, speed: float, level: float) -> float:
    """Return the flux at which errors at the bound have a median of `level` of the speed.

    `covariances` (..., 2, 2): least covariances at one photon per frame; they fall as 1/flux
    without dark counts; `speed`: px per frame.
    """
    return (median_endpoint_error(covariances) / (level * speed)) ** 2


SPEED_PX, LEVEL, GRID = 3 * 240 / 251, 0.25, block_grid((240, 240))
FLUXES = np.logspace(3, 7, 13).tolist()
MEASURED = Path("out/pictures/leaderboard.json")
clean = []
for seed in range(8):
    texture = dead_leaves((251, 275), generator(seed, "leaderboard"), (3.0, 80.0))
    clean.append(MovingTemplate(texture, 3, 240, "area").light(0, 8))
blockwise = [each for each in METHODS.values() if isinstance(each, BlockDetector)]
detectors = [each for each in blockwise if each.name not in ("PPF", "zero")]  # PPF is slow
needed: dict[str, MedianPhotons] = {}
if MEASURED.exists():
    needed = {name: MedianPhotons(*each) for name, each in json.loads(MEASURED.read_text()).items()}
for detector in detectors:
    if detector.name in needed:
        continue

    def is_good(flux: float, detector: BlockDetector = detector) -> Mask:
        counts = (draw_counts(light * flux, 0, "leaderboard", at) for at, light in enumerate(clean))
        found = [confined_velocities(detector, each, GRID, 7) for each in counts]
        return is_within(np.stack(found), (SPEED_PX, 0.0), LEVEL)

    needed[detector.name] = photons_for_half(is_good, FLUXES)
    MEASURED.parent.mkdir(parents=True, exist_ok=True)
    MEASURED.write_text(json.dumps(needed))
order = sorted(detectors, key=lambda detector: -needed[detector.name].photons)
with house_style({"axes.grid.axis": "x"}):
    figure, axes = plt.subplots(figsize=(6, 1.6 + 0.3 * len(order)), layout="constrained")
    for place, detector in enumerate(order):
        photons, low, high = (min(value, FLUXES[-1]) for value in needed[detector.name])
        color = method_style(detector.name)["color"]
        axes.plot([low, high], [place, place], color=color, linewidth=5, alpha=0.35)
        is_reached = photons < FLUXES[-1]
        axes.plot(photons, place, "o" if is_reached else ">", color=color, markersize=9)
    information = np.stack([fisher_information(each[-1], GRID)[1:-1, 1:-1] for each in clean])
    for frames, dash in ((8, "--"), (2, ":")):
        covariance = cramer_rao_covariance(information, frames)
        photons = bound_photons(covariance, SPEED_PX, LEVEL)
        label = f"bound, {frames} frames"
        axes.axvline(photons, color=BLACK, linestyle=dash, linewidth=1.5, label=label)
    axes.set(xscale="log", xlabel="photons for a median error of 25 %", xlim=(200, 2e7))
    names = [f"{each.label}, 8 frames" if each.memory_frames > 1 else each.label for each in order]
    axes.set_yticks(range(len(order)), names)
    axes.xaxis.set_major_formatter(NUMBERS)
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    figure.legend(loc="outside lower right", ncols=2)
    figure.savefig(Path(__file__).parent.parent / "leaderboard.png", dpi=140)
