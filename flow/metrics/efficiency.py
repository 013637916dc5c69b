"""Velocity methods against the truth and the Poisson translation bound, block by block alone.

What counts is how many photons a method gathers for one estimate. A method that smooths its flow
over the frame, climbs a pyramid or takes one velocity for all blocks gathers more than its block.
So that all have the same support, every method is given each block as a frame of its own: the block
and a margin as wide as the search around it, cut out of the counts. Nothing else is seen.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.flow.detectors.base import FloatArray, Frames
from megalopta.flow.detectors.blocks import BlockDetector, BlockGrid
from megalopta.flow.metrics.photon_threshold import first_crossing
from megalopta.flow.metrics.translation_bound import median_endpoint_error

_REPLICATES = 1000


class MedianPhotons(NamedTuple):
    """Photons per frame that a method needs, and the interval that holds them in 95 % of cases."""

    photons: float
    low: float
    high: float


def confined(detector: BlockDetector, block_px: int, margin_px: int) -> BlockDetector:
    """Return a detector for frames that are one block and its margin, searching all of it."""
    changes = {"block_px": block_px, "fewest_blocks": 1}
    if "radius_px" in type(detector).model_fields:
        changes["radius_px"] = margin_px
    return detector.model_copy(update=changes)


def confined_velocities(
    detector: BlockDetector, frames: Frames, grid: BlockGrid, margin_px: int
) -> FloatArray:
    """Return the newest velocity of each block inside, seen through its support alone.

    `detector`: any that gives velocities; its parameters for blocks and search are replaced;
    `frames` (T, H, W): counts; of them, the last `memory_frames` + 1 are used; `grid`: blocks of
    the frames; those at the border are left out; `margin_px`: from 1 to the side of a block.
    Returns (rows − 2, columns − 2, 2), px per frame.

    Raises ValueError when the margin is not of that range.
    """
    if not 1 <= margin_px <= grid.block_px:
        raise ValueError(f"margin_px {margin_px}: give 1 to {grid.block_px}, the side of a block")
    alone = confined(detector, grid.block_px, margin_px)
    side = grid.block_px + 2 * margin_px
    newest = frames[-1 - detector.memory_frames :]
    velocities = np.empty((grid.rows - 2, grid.columns - 2, 2))
    for row, column in np.ndindex(velocities.shape[:2]):
        top = grid.top + (row + 1) * grid.block_px - margin_px
        left = grid.left + (column + 1) * grid.block_px - margin_px
        cut = newest[:, top : top + side, left : left + side]
        velocities[row, column] = alone.respond(cut)[-1, 0, 0]
    return velocities


def is_within(
    velocities: FloatArray, truth: tuple[float, float], level: float
) -> NDArray[np.bool_]:
    """Return whether |v − truth| < level·|truth| for velocities (..., 2); never where undefined."""
    error = np.hypot(*np.moveaxis(velocities - np.asarray(truth), -1, 0))
    return np.asarray(error < level * np.hypot(*truth))


def photons_for_half(
    is_good: Callable[[float], NDArray[np.bool_]], fluxes: Sequence[float], rng: np.random.Generator
) -> MedianPhotons:
    """Return the flux at which half of the blocks are good: the median error is at its level.

    The crossing is bracketed by bisection, so few of the fluxes are tried. Between them the share
    of good blocks, which also grows smoothly where a method answers in whole pixels and its median
    error falls in steps, is interpolated linearly over log flux: about its half a share is
    straight. The interval is that of a bootstrap over groups, the same at all fluxes tried.

    Parameters
    ----------
    is_good
        Flux to one truth value per block, (groups, ...); the same blocks at each flux. Groups are
        independent of each other, the blocks of one need not be.
    fluxes
        Growing; two or more.
    rng
        For the interval.

    Returns
    -------
    MedianPhotons
        Infinite when no more than half are good at the largest flux; 0 when more than half are at
        the smallest.
    """
    tried: dict[int, FloatArray] = {}

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
    groups = len(tried[low])
    drawn = rng.multinomial(groups, np.full(groups, 1 / groups), _REPLICATES)
    while True:
        at = np.array([fluxes[index] for index in sorted(tried)])
        good = np.array([tried[index] for index in sorted(tried)])
        replicates = _half(at, drawn @ good.T / groups)
        ends = np.quantile(replicates, (0.025, 0.975), method="inverted_cdf")
        lowest = min(tried)
        if ends[0] > 0 or lowest == 0:
            return MedianPhotons(float(_half(at, good.mean(axis=1))), *map(float, ends))
        more_than_half(lowest - 1)  # the interval reaches below the fluxes tried


def _half(fluxes: FloatArray, shares: FloatArray) -> FloatArray:
    # first_crossing is linear in the log of an error: this one's log is the share of bad blocks.
    return first_crossing(fluxes, np.exp(1 - shares), np.exp(0.5))


def bound_photons(covariances: FloatArray, speed: float, level: float) -> float:
    """Return the flux at which errors at the bound have a median of `level` of the speed.

    `covariances` (..., 2, 2): least covariances at one photon per frame; they fall as 1/flux,
    without dark counts; `speed`: px per frame.
    """
    return (median_endpoint_error(covariances) / (level * speed)) ** 2


def variance_efficiency(velocities: FloatArray, covariances: FloatArray) -> float:
    """Return the bound over the variance of the velocities, both summed over x and y.

    `velocities` (draws, ..., 2): of the same blocks, from independent draws of photons;
    `covariances` (..., 2, 2): least covariances of the blocks. Returns median over the blocks whose
    bound is finite.
    """
    variance = velocities.var(axis=0, ddof=1).sum(axis=-1)
    bound = np.trace(covariances, axis1=-2, axis2=-1)
    return float(np.median((bound / variance)[np.isfinite(bound)]))
