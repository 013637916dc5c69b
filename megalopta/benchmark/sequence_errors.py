"""What is measured on one rendered sequence: each metric is a function that adds its cases.

A block's error is the endpoint error in px of the full image per frame; a block without velocity
counts as one that reports zero motion. Means are over all blocks of a group.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from megalopta.benchmark.intervals import Sums
from megalopta.benchmark.methods import Methods, directional_methods
from megalopta.benchmark.ranking_settings import NO_POOLING, Pooling, RankingSettings
from megalopta.benchmark.sequence_truth import BlockTruths, SequenceTruth
from megalopta.benchmark.table import Case
from megalopta.benchmark.velocities import LIKELIHOODS, Drawn, Velocities
from megalopta.core.arrays import Floats
from megalopta.dataset.store import Dataset
from megalopta.flow.benchmark.settings import default_warm_up
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.egomotion.camera_motion import CameraMotion, motion_of_flow
from megalopta.flow.egomotion.wide_field import YawRateTest, yaw_rates_deg_s

ERROR = "epe_px"
ROTATION, HEADING = "rotation_error_deg", "heading_error_deg"
YAW, YAW_OF_LIGHT, TRUE_YAW = "yaw_error_deg_s", "yaw_error_of_light_deg_s", "true_yaw_deg_s"

STILL = "zero motion"
"""What a method must beat: no motion anywhere"""

BOUND = "Poisson bound"

_STILL_M = 1e-9
_UNKNOWN = math.nan, math.nan

CameraErrors: TypeAlias = tuple[float, float]
"""Angles of the rotation that remains between the estimated and the true one, and between the
estimated and the true direction of translation (degrees); NaN where unknown"""

Measured: TypeAlias = Iterator[tuple[Case, Sums]]
"""Sums over the pairs of frames of a sequence, or one number of it, by case"""


@dataclass(frozen=True)
class Example:
    """Velocities (rows, columns, 2) of one pair of frames, not pooled more than any."""

    truth: Floats
    found: Mapping[str, Mapping[float, Floats]]
    """By method and photons per frame"""


class RankedSequence:
    """A sequence, the methods on it, and what is true of it."""

    def __init__(
        self,
        dataset: Dataset,
        settings: RankingSettings,
        methods: Methods,
        velocities: Velocities,
    ) -> None:
        self.dataset, self.settings, self.methods = dataset, settings, methods
        self.velocities = velocities
        self._traced: dict[BlockGrid, SequenceTruth] = {}
        self._truths: dict[tuple[BlockGrid, Pooling], BlockTruths] = {}

    def grid(self, name: str, pixels: int) -> BlockGrid:
        """Return the blocks of a method on pooled frames; ValueError where these are too small."""
        camera = self.dataset.configuration.camera
        return self.methods[name].grid(Pooling(pixels, 1).shape((camera.height, camera.width)))

    def truth(self, grid: BlockGrid, pooling: Pooling) -> BlockTruths:
        """Return the truth of the blocks between pooled frames."""
        if (grid, pooling) not in self._truths:
            if grid not in self._traced:
                self._traced[grid] = SequenceTruth(self.dataset, grid)
            self._truths[grid, pooling] = self._traced[grid].at(pooling)
        return self._truths[grid, pooling]

    def noisy(self, name: str, pooling: Pooling, flux: float) -> list[Floats]:
        """Return the velocities that a method finds in each draw of the photons."""
        repeats = range(self.settings.repeats)
        found = (Drawn(pooling, flux, repeat) for repeat in repeats)
        return [self.velocities.of(self.methods[name], drawn) for drawn in found]


def endpoint_errors(sequence: RankedSequence) -> Measured:
    """Yield errors of every method by group, of zero motion, and the least that photons allow."""
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
        bound = np.minimum(sequence.velocities.bound(grid, pooling, flux), speed)
        yield from _by_group([speed], truth, Case(ERROR, STILL, flux, "", *pooling))
        yield from _by_group([bound], truth, Case(ERROR, BOUND, flux, "", *pooling))


def camera_errors(sequence: RankedSequence) -> Measured:
    """Yield errors of the camera's rotation and heading, from flow and as the most likely ones."""
    dataset, settings, velocities = sequence.dataset, sequence.settings, sequence.velocities
    frames = dataset.configuration.trajectory.frames
    pairs = _chosen_pairs(frames, settings.camera_pairs).tolist()
    if not pairs:
        return
    for flux in settings.fluxes:
        for name in sequence.methods if settings.finest == NO_POOLING else ():
            found, grid = sequence.noisy(name, NO_POOLING, flux)[0], sequence.grid(name, 1)
            errors = [_errors_of_flow(dataset, grid, found[pair], pair) for pair in pairs]
            yield from _camera_cases(name, flux, errors)
        for name in LIKELIHOODS:
            motions = velocities.likely_motions(Drawn(NO_POOLING, flux, 0), name, pairs)
            errors = [
                _errors_of_motion(dataset, CameraMotion(each[:3], each[3:]), pair)
                for pair, each in zip(pairs, motions, strict=True)
            ]
            yield from _camera_cases(name, flux, errors)


def yaw_errors(sequence: RankedSequence) -> Measured:
    """Learn the yaw rate from clean answers to the first half of a sequence; try it on the rest."""
    rates = yaw_rates_deg_s(sequence.dataset.configuration.trajectory)
    settings = sequence.settings
    for name, detector in directional_methods(sequence.methods, settings.wide_field).items():
        for flux in settings.fluxes:
            test = YawRateTest(detector, rates, default_warm_up(len(rates) + 1, [detector]))
            draws = (Drawn(NO_POOLING, flux, repeat) for repeat in (None, 0))
            test.add(*(sequence.velocities.of(detector, drawn) for drawn in draws))
            if found := test.result():
                yield Case(TRUE_YAW, name, flux), _values([found.true_deg_s])
                yield Case(YAW_OF_LIGHT, name, flux), _values([found.ideal_deg_s])
                yield Case(YAW, name, flux), _values([found.counts_deg_s])


METRICS = (endpoint_errors, camera_errors, yaw_errors)
"""All that is measured: `ERROR` is averaged over blocks, of others the median counts"""


def example_of(sequence: RankedSequence) -> Example:
    """Return true and found velocities of the pair in the middle."""
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
    """Return the endpoint errors (pairs, rows, columns) of the blocks inside."""
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
    """Return so many pairs, by their first frames, spread over a sequence of so many frames.

    All have the frames around them that the likelihood sees, if the sequence is long enough.
    """
    most = max(LIKELIHOODS.values())
    before = most // 2 - 1 if frames >= most else 0
    return np.unique(np.linspace(before, frames - 2 - before, count).astype(int))


def _errors_of_flow(
    dataset: Dataset, grid: BlockGrid, velocities: Floats, pair: int
) -> CameraErrors:
    """Return the errors of the motion that fits the flow (rows, columns, 2) of a pair best."""
    camera = dataset.configuration.camera
    inside = np.s_[1:-1, 1:-1]
    scale = np.array([camera.width / grid.shape[1], camera.height / grid.shape[0]])
    try:
        found = motion_of_flow(camera, grid.centers[inside] * scale, velocities[inside])
    except ValueError:  # too few blocks have a velocity
        return _UNKNOWN
    return _errors_of_motion(dataset, found, pair)


def _errors_of_motion(dataset: Dataset, found: CameraMotion, pair: int) -> CameraErrors:
    """Return the errors of a motion between a frame and the next."""
    if np.isnan(found.rotation_deg).any():
        return _UNKNOWN
    poses = dataset.configuration.trajectory.poses()[pair : pair + 2]
    turn = poses[0, :3, :3].T @ poses[1, :3, :3]
    way = poses[0, :3, :3].T @ (poses[1, :3, 3] - poses[0, :3, 3])
    left = Rotation.from_rotvec(found.rotation_deg, degrees=True).inv() * Rotation.from_matrix(turn)
    length = float(np.linalg.norm(way))
    heading = np.nan if length < _STILL_M else _angle_deg(found.heading, way / length)
    return float(np.degrees(left.magnitude())), heading


def _angle_deg(first: Floats, second: Floats) -> float:
    return float(np.degrees(np.arccos(np.clip(first @ second, -1, 1))))


def _camera_cases(name: str, flux: float, errors: Sequence[CameraErrors]) -> Measured:
    for metric, values in zip((ROTATION, HEADING), np.transpose(errors), strict=True):
        yield Case(metric, name, flux), _values(values)


def _values(values: Sequence[float] | Floats) -> Sums:
    return Sums(np.array(values), np.ones(len(values)))
