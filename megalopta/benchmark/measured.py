"""What is measured on one sequence: errors of every method at every pooling and flux."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from megalopta.benchmark.camera_motion import (
    LIKELIHOODS,
    CameraErrors,
    chosen_pairs,
    errors_of_flow,
    errors_of_motion,
)
from megalopta.benchmark.methods import Methods
from megalopta.benchmark.ranking_errors import (
    STILL,
    Sums,
    endpoint_errors,
    pair_sums,
)
from megalopta.benchmark.ranking_record import BOUND
from megalopta.benchmark.ranking_settings import Pooling, RankingSettings
from megalopta.benchmark.sequence_truth import BlockTruths, SequenceTruth
from megalopta.benchmark.velocities import Drawn, Velocities
from megalopta.benchmark.yaw_rate import YawErrors
from megalopta.core.arrays import Floats
from megalopta.dataset.store import Dataset
from megalopta.flow.detectors.blocks import BlockDetector, BlockGrid
from megalopta.flow.egomotion.heading import CameraMotion
from megalopta.flow.metrics.response_error import combine, error_sums


@dataclass(frozen=True)
class Example:
    """Velocities (rows, columns, 2) of one pair of frames, not pooled more than any."""

    truth: Floats
    found: Mapping[str, Mapping[float, Floats]]
    """By method and photons per frame"""


@dataclass(frozen=True)
class Part:
    """Of one sequence."""

    photons_per_lux_s: float
    sums: Mapping[tuple[Pooling, float, str, str], Sums]
    consistency: Mapping[tuple[Pooling, float, str], float]
    camera: Mapping[tuple[float, str], list[CameraErrors]]
    yaw: YawErrors
    example: Example


def grid_of(dataset: Dataset, method: BlockDetector, pixels: int) -> BlockGrid:
    """Blocks of a method on pooled frames. Raises ValueError where these are too small."""
    camera = dataset.configuration.camera
    return method.grid(Pooling(pixels, 1).shape((camera.height, camera.width)))


def measured(
    dataset: Dataset,
    settings: RankingSettings,
    methods: Methods,
    velocities: Velocities,
    yaw: YawErrors,
) -> Part:
    """Return the errors of every method, of the answer 0 and of the Poisson bound."""
    sums: dict[tuple[Pooling, float, str, str], Sums] = {}
    consistency: dict[tuple[Pooling, float, str], float] = {}
    camera: dict[tuple[float, str], list[CameraErrors]] = {}
    frames_there = dataset.configuration.trajectory.frames
    pairs = chosen_pairs(frames_there, settings.camera_pairs).tolist()
    shown: dict[str, dict[float, Floats]] = {name: {} for name in methods}
    true: dict[str, Floats] = {}
    for pixels in settings.pixels_pooled:
        grids = {name: grid_of(dataset, each, pixels) for name, each in methods.items()}
        traced = {grid: SequenceTruth(dataset, grid) for grid in set(grids.values())}
        for frames in settings.frames_pooled:
            pooling = Pooling(pixels, frames)
            truths = {grid: each.at(pooling) for grid, each in traced.items()}
            for flux in settings.fluxes:
                for name, grid in grids.items():
                    truth, method = truths[grid], methods[name]
                    ideal = velocities.of(method, Drawn(pooling, flux, None))
                    noisy = [
                        velocities.of(method, Drawn(pooling, flux, repeat))
                        for repeat in range(settings.repeats)
                    ]
                    errors = [endpoint_errors(each, truth) for each in noisy]
                    for group, among in truth.groups.items():
                        sums[pooling, flux, group, name] = pair_sums(errors, among)
                    consistency[pooling, flux, name] = _consistency(method, ideal, noisy)
                    if pooling == Pooling(1, 1):
                        camera[flux, name] = [
                            errors_of_flow(dataset, grid, noisy[0][pair], pair) for pair in pairs
                        ]
                    if pooling == settings.finest:
                        middle = len(truth.velocities) // 2
                        true[name] = truth.velocities[middle]
                        shown[name][flux] = noisy[0][middle, 1:-1, 1:-1]
                _add_references(sums, truths, velocities, pooling, flux)
    if pairs:
        for flux, name in product(settings.fluxes, LIKELIHOODS):
            found = velocities.likely_motions(Drawn(Pooling(1, 1), flux, 0), name, pairs)
            camera[flux, name] = [
                errors_of_motion(dataset, CameraMotion(each[:3], each[3:]), pair)
                for pair, each in zip(pairs, found, strict=True)
            ]
    example = Example(next(iter(true.values())), shown)
    return Part(velocities.photons_per_lux_s, sums, consistency, camera, yaw, example)


def _add_references(
    sums: dict[tuple[Pooling, float, str, str], Sums],
    truths: Mapping[BlockGrid, BlockTruths],
    velocities: Velocities,
    pooling: Pooling,
    flux: float,
) -> None:
    """Errors of the answer 0, and the least that the photons allow, on the first grid."""
    grid, truth = next(iter(truths.items()))
    speed = np.linalg.norm(truth.velocities, axis=-1)
    bound = np.minimum(velocities.bound(grid, pooling, flux), speed)
    for group, among in truth.groups.items():
        sums[pooling, flux, group, STILL] = pair_sums([speed], among)
        sums[pooling, flux, group, BOUND] = pair_sums([bound], among)


def _consistency(detector: BlockDetector, ideal: Floats, noisy: Sequence[Floats]) -> float:
    found = [
        combine([error_sums(detector, ideal, each)], np.concatenate).of_sequence("literal")
        for each in noisy
    ]
    return float(np.mean(found))
