"""Velocity methods against the truth and the Poisson translation bound, block by block alone.

What counts is how many photons a method gathers for one estimate. A method that smooths its flow
over the frame, climbs a pyramid or takes one velocity for all blocks gathers more than its block.
So that all have the same support, every method is given each block as a frame of its own: the block
and a margin as wide as the search around it, cut out of the counts. Nothing else is seen.
"""

from collections.abc import Callable, Sequence

import numpy as np

from megalopta.flow.block_detector import BlockDetector
from megalopta.flow.blocks import BlockGrid
from megalopta.flow.detector import FloatArray, Frames
from megalopta.flow.threshold import first_crossing
from megalopta.flow.translation_bound import median_endpoint_error


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

    Parameters
    ----------
    detector
        Any that gives velocities; its parameters for blocks and search are replaced.
    frames : (T, H, W)
        Counts; of them, the last `memory_frames` + 1 are used.
    grid
        Blocks of the frames; those at the border are left out.
    margin_px : int
        From 1 to the side of a block.

    Returns
    -------
    (rows − 2, columns − 2, 2), px per frame.

    Raises
    ------
    ValueError
        When the margin is not of that range.
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


def median_relative_error(velocities: FloatArray, truth: tuple[float, float]) -> float:
    """Return the median of |v − truth|/|truth| over all velocities (..., 2).

    An undefined velocity (NaN) has an error of 1, as the answer 0 would.
    """
    error = np.hypot(*np.moveaxis(velocities - np.asarray(truth), -1, 0)) / np.hypot(*truth)
    return float(np.median(np.where(np.isnan(error), 1.0, error)))


def photons_for_error(
    error_at: Callable[[float], float], fluxes: Sequence[float], level: float
) -> float:
    """Return the flux at which an error that falls with the flux reaches a level.

    The crossing is bracketed by bisection, so few of the fluxes are tried, and interpolated
    linearly in log error over log flux.

    Parameters
    ----------
    error_at
        Flux to error.
    fluxes
        Growing; two or more.
    level : float

    Returns
    -------
    float
        Infinite when the error at the largest flux is not below the level; 0 when that at the
        smallest is.
    """
    low, high = 0, len(fluxes) - 1
    errors = {high: error_at(fluxes[high])}
    while high - low > 1 and errors[high] < level:
        middle = (low + high) // 2
        errors[middle] = error_at(fluxes[middle])
        low, high = (low, middle) if errors[middle] < level else (middle, high)
    if low not in errors:
        errors[low] = error_at(fluxes[low]) if errors[high] < level else np.inf
    bracket = np.array([fluxes[low], fluxes[high]])
    return float(first_crossing(bracket, np.array([errors[low], errors[high]]), level))


def bound_photons(covariances: FloatArray, speed: float, level: float) -> float:
    """Return the flux at which errors at the bound have a median of `level` of the speed.

    Parameters
    ----------
    covariances : (..., 2, 2)
        Least covariances at one photon per frame; they fall as 1/flux, without dark counts.
    speed : float
        px per frame.
    level : float
    """
    return (median_endpoint_error(covariances) / (level * speed)) ** 2


def variance_efficiency(velocities: FloatArray, covariances: FloatArray) -> float:
    """Return the bound over the variance of the velocities, both summed over x and y.

    Parameters
    ----------
    velocities : (draws, ..., 2)
        Of the same blocks, from independent draws of photons.
    covariances : (..., 2, 2)
        Least covariances of the blocks.

    Returns
    -------
    float
        Median over the blocks whose bound is finite.
    """
    variance = velocities.var(axis=0, ddof=1).sum(axis=-1)
    bound = np.trace(covariances, axis1=-2, axis2=-1)
    return float(np.median((bound / variance)[np.isfinite(bound)]))
