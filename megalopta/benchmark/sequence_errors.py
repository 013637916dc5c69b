"""Metrics on one rendered sequence: each is a function that yields its cases.

A block's error is its endpoint error in px of the full image per frame; a block without velocity
counts as zero motion. Means are over all blocks of a group (`block_truths`).
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from megalopta.benchmark.block_truths import BlockTruths
from megalopta.benchmark.methods import directional_methods
from megalopta.benchmark.ranked_sequence import LIKELIHOODS, Drawn, RankedSequence
from megalopta.benchmark.ranking_settings import NO_POOLING
from megalopta.benchmark.table import Case, Sums
from megalopta.core.arrays import Floats
from megalopta.dataset.store import Dataset
from megalopta.flow.benchmark import default_warm_up
from megalopta.flow.camera_motion import motion_of_flow
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.metrics.endpoint_error import angles_deg
from megalopta.flow.wide_field import YawRateTest, yaw_rates_deg_s
from megalopta.scenes.cameras.base import Camera

ERROR = "epe_px"
ROTATION, HEADING = "rotation_error_deg", "heading_error_deg"
YAW, YAW_OF_LIGHT, TRUE_YAW = "yaw_error_deg_s", "yaw_error_of_light_deg_s", "true_yaw_deg_s"

STILL = "zero motion"
"""Baseline that a method must beat: no motion anywhere"""

BOUND = "Poisson bound"

_STILL_M = 1e-9

Measured: TypeAlias = Iterator[tuple[Case, Sums]]
"""Sums over the pairs of frames of a sequence, or one number for it, by case"""


@dataclass(frozen=True)
class Example:
    """Velocities (rows, columns, 2) of one pair of frames at the finest pooling."""

    truth: Floats
    found: Mapping[str, Mapping[float, Floats]]
    """By method and photons per frame"""


def endpoint_errors(sequence: RankedSequence) -> Measured:
    """Yield errors of every method and of zero motion, by group, and the Poisson bound."""
    for pooling, flux in product(sequence.settings.poolings, sequence.settings.fluxes):
        grids = {name: sequence.grid(name, pooling.pixels) for name in sequence.methods}
        for name, grid in grids.items():
            truth = sequence.truth(grid, pooling)
            found = sequence.noisy(name, pooling, flux)
            distances = [_distances(each, truth) for each in found]
            yield from _by_group(distances, truth, Case(ERROR, name, flux, "", *pooling))
        grid = next(iter(grids.values()))
        truth = sequence.truth(grid, pooling)
        speed = np.linalg.norm(truth.velocities, axis=-1)
        bound = np.minimum(sequence.bound(grid, pooling, flux), speed)
        yield from _by_group([speed], truth, Case(ERROR, STILL, flux, "", *pooling))
        yield from _by_group([bound], truth, Case(ERROR, BOUND, flux, "", *pooling))


def camera_errors(sequence: RankedSequence) -> Measured:
    """Yield errors of the camera's rotation and heading, from flow and by maximum likelihood."""
    settings = sequence.settings
    frames = sequence.dataset.configuration.trajectory.frames
    pairs = _chosen_pairs(frames, settings.camera_pairs).tolist()
    for flux in settings.fluxes if pairs else ():
        for name, motions in _camera_motions(sequence, flux, pairs):
            found = zip(motions, pairs, strict=True)
            errors = [_motion_errors(sequence.dataset, *each) for each in found]
            for metric, values in zip((ROTATION, HEADING), np.transpose(errors), strict=True):
                yield Case(metric, name, flux), _values(values)


def _camera_motions(
    sequence: RankedSequence, flux: float, pairs: Sequence[int]
) -> Iterator[tuple[str, Sequence[Floats]]]:
    """Yield each estimator's rotations (°) and headings of pairs, (6,) each; NaN if it has none."""
    for name in sequence.methods if sequence.settings.finest == NO_POOLING else ():
        flow, grid = sequence.noisy(name, NO_POOLING, flux)[0], sequence.grid(name, 1)
        yield name, [_fitted(sequence.dataset.configuration.camera, grid, flow[at]) for at in pairs]
    for name in LIKELIHOODS:
        drawn = Drawn(NO_POOLING, flux, 0)
        yield name, list(sequence.likely_motions(drawn, name, pairs))


def yaw_errors(sequence: RankedSequence) -> Measured:
    """Learn the yaw rate from noise-free responses to half of a sequence; test on the rest."""
    rates = yaw_rates_deg_s(sequence.dataset.configuration.trajectory)
    settings = sequence.settings
    for name, detector in directional_methods(sequence.methods, settings.wide_field).items():
        for flux in settings.fluxes:
            test = YawRateTest(detector, rates, default_warm_up(len(rates) + 1, [detector]))
            draws = (Drawn(NO_POOLING, flux, repeat) for repeat in (None, 0))
            test.add(*(sequence.velocities(detector, drawn) for drawn in draws))
            if found := test.result():
                yield Case(TRUE_YAW, name, flux), _values([found.true_deg_s])
                yield Case(YAW_OF_LIGHT, name, flux), _values([found.ideal_deg_s])
                yield Case(YAW, name, flux), _values([found.counts_deg_s])


METRICS = (endpoint_errors, camera_errors, yaw_errors)
"""All metrics: `ERROR` is averaged over blocks, of others the median counts"""


def example_of(sequence: RankedSequence) -> Example:
    """Return true and estimated velocities of the pair in the middle."""
    finest, found = sequence.settings.finest, {}
    for name in sequence.methods:
        truth = sequence.truth(sequence.grid(name, finest.pixels), finest).velocities
        middle = len(truth) // 2
        found[name] = {
            flux: sequence.noisy(name, finest, flux)[0][middle, 1:-1, 1:-1]
            for flux in sequence.settings.fluxes
        }
    grid = sequence.grid(next(iter(found)), finest.pixels)
    return Example(sequence.truth(grid, finest).velocities[middle], found)


def _distances(velocities: Floats, truth: BlockTruths) -> Floats:
    """Return the endpoint errors (pairs, rows, columns) of the inner blocks."""
    inside = velocities[:, 1:-1, 1:-1]
    answered = np.isfinite(inside).all(axis=-1, keepdims=True)
    return np.asarray(np.linalg.norm(np.where(answered, inside, 0) - truth.velocities, axis=-1))


def _by_group(errors: Sequence[Floats], truth: BlockTruths, case: Case) -> Measured:
    """Sum errors (pairs, rows, columns) of several draws over the blocks of each group."""
    for group, among in truth.groups.items():
        totals = np.sum([np.where(among, each, 0).sum(axis=(1, 2)) for each in errors], axis=0)
        blocks = len(errors) * among.sum(axis=(1, 2)).astype(np.float64)
        yield case._replace(group=group), Sums(np.asarray(totals), blocks)


def _chosen_pairs(frames: int, count: int) -> NDArray[np.intp]:
    """Return `count` pairs, by their first frames, spread over a sequence.

    All have the frames around them that the likelihood uses, if the sequence is long enough.
    """
    most = max(LIKELIHOODS.values())
    before = most // 2 - 1 if frames >= most else 0
    return np.unique(np.linspace(before, frames - 2 - before, count).astype(int))


def _fitted(camera: Camera, grid: BlockGrid, velocities: Floats) -> Floats:
    """Return the motion that best fits the flow (rows, columns, 2) of a pair, (6,)."""
    inside = np.s_[1:-1, 1:-1]
    scale = np.array([camera.width / grid.shape[1], camera.height / grid.shape[0]])
    try:
        found = motion_of_flow(camera, grid.centers[inside] * scale, velocities[inside])
    except ValueError:  # too few blocks have a velocity
        return np.full(6, np.nan)
    return np.concatenate((found.rotation_deg, found.heading))


def _motion_errors(dataset: Dataset, found: Floats, pair: int) -> tuple[float, float]:
    """Return the errors of a motion (6,) between a frame and the next (degrees), NaN if unknown.

    They are the angle of the remaining rotation, and the angle between the headings.
    """
    if np.isnan(found).any():
        return math.nan, math.nan
    poses = dataset.configuration.trajectory.poses()[pair : pair + 2]
    turn = poses[0, :3, :3].T @ poses[1, :3, :3]
    way = poses[0, :3, :3].T @ (poses[1, :3, 3] - poses[0, :3, 3])
    left = Rotation.from_rotvec(found[:3], degrees=True).inv() * Rotation.from_matrix(turn)
    moves = np.linalg.norm(way) >= _STILL_M
    heading = float(angles_deg(found[3:], way)) if moves else math.nan
    return float(np.degrees(left.magnitude())), heading


def _values(values: Sequence[float] | Floats) -> Sums:
    return Sums(np.array(values), np.ones(len(values)))
