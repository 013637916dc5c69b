"""The benchmark of flow methods on rendered sequences with true motion."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from megalopta.arrays import Floats
from megalopta.dataset import Dataset
from megalopta.flow.detectors import BlockDetector, BlockGrid
from megalopta.flow.metrics import combine, error_sums
from megalopta.progress import progress
from megalopta.ranking.camera_motion import CameraErrors, camera_errors
from megalopta.ranking.errors import (
    STILL,
    PairSums,
    Replicates,
    endpoint_errors,
    joined,
    pair_sums,
)
from megalopta.ranking.methods import Methods
from megalopta.ranking.pooling import Pooling
from megalopta.ranking.record import (
    BOUND,
    BestMethod,
    CameraMotionError,
    Consistency,
    MeanError,
    Order,
    Ranking,
)
from megalopta.ranking.settings import RankingSettings
from megalopta.ranking.truth import OPPOSED, BlockTruths, SequenceTruth
from megalopta.ranking.velocities import Drawn, Velocities, draws
from megalopta.ranking.yaw_rate import YawErrors, directional_methods, typical, yaw_errors


@dataclass(frozen=True)
class Example:
    """Velocities (rows, columns, 2) of one pair of frames, not pooled more than any."""

    truth: Floats
    found: Mapping[str, Mapping[float, Floats]]
    """By method and photons per frame"""


def rank_methods(
    datasets: Sequence[Dataset], settings: RankingSettings, methods: Methods, folder: Path
) -> tuple[Ranking, Example]:
    """Measure every method on every sequence; velocities are kept in a folder as they are found.

    Raises
    ------
    ValueError
        When the frames are too small, or too few, for a pooling.
    """
    for dataset in datasets:
        _check(dataset, settings, methods)
    wide = directional_methods(methods, settings.wide_field)
    clips = len(methods) * sum(1 for _ in draws(settings)) + 2 * len(wide) * len(settings.fluxes)
    with progress("Ranking methods", len(datasets) * clips, "clip") as advance:
        parts = []
        for dataset in datasets:
            velocities = Velocities(dataset, settings, folder / dataset.sequence, advance)
            yaw = yaw_errors(dataset, settings, wide, velocities)
            parts.append(_measured(dataset, settings, methods, velocities, yaw))
    return _ranking(datasets, settings, parts), parts[0].example


@dataclass(frozen=True)
class _Part:
    """Of one sequence."""

    photons_per_lux_s: float
    sums: Mapping[tuple[Pooling, float, str, str], PairSums]
    consistency: Mapping[tuple[Pooling, float, str], float]
    camera: Mapping[tuple[float, str], list[CameraErrors]]
    yaw: YawErrors
    example: Example


def _check(dataset: Dataset, settings: RankingSettings, methods: Methods) -> None:
    frames, fewest = dataset.configuration.trajectory.frames, max(settings.frames_pooled)
    if frames < 3 * fewest:
        raise ValueError(
            f"{dataset.sequence} has {frames} frames: frames_pooled {fewest} needs {3 * fewest}"
        )
    for name, method in methods.items():
        for pixels in settings.pixels_pooled:
            try:
                _grid(dataset, method, pixels)
            except ValueError as problem:
                raise ValueError(f"pixels_pooled {pixels} for {name}: {problem}") from None


def _grid(dataset: Dataset, method: BlockDetector, pixels: int) -> BlockGrid:
    """Blocks of a method on pooled frames. Raises ValueError where these are too small."""
    camera = dataset.configuration.camera
    return method.grid(Pooling(pixels, 1).shape((camera.height, camera.width)))


def _measured(
    dataset: Dataset,
    settings: RankingSettings,
    methods: Methods,
    velocities: Velocities,
    yaw: YawErrors,
) -> _Part:
    sums: dict[tuple[Pooling, float, str, str], PairSums] = {}
    consistency: dict[tuple[Pooling, float, str], float] = {}
    camera: dict[tuple[float, str], list[CameraErrors]] = {}
    shown: dict[str, dict[float, Floats]] = {name: {} for name in methods}
    true: dict[str, Floats] = {}
    for pixels in settings.pixels_pooled:
        grids = {name: _grid(dataset, each, pixels) for name, each in methods.items()}
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
                        camera[flux, name] = _camera(dataset, grid, noisy[0], settings.camera_pairs)
                    if pooling == settings.finest:
                        middle = len(truth.velocities) // 2
                        true[name] = truth.velocities[middle]
                        shown[name][flux] = noisy[0][middle, 1:-1, 1:-1]
                _add_references(sums, truths, velocities, pooling, flux)
    example = Example(next(iter(true.values())), shown)
    return _Part(velocities.photons_per_lux_s, sums, consistency, camera, yaw, example)


def _add_references(
    sums: dict[tuple[Pooling, float, str, str], PairSums],
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


def _camera(
    dataset: Dataset, grid: BlockGrid, velocities: Floats, count: int
) -> list[CameraErrors]:
    pairs = np.unique(np.linspace(0, len(velocities) - 1, count).astype(int)) if count else ()
    return [camera_errors(dataset, grid, velocities[pair], int(pair)) for pair in pairs]


def _ranking(
    datasets: Sequence[Dataset], settings: RankingSettings, parts: Sequence[_Part]
) -> Ranking:
    keys = parts[0].sums.keys()
    sums = {key: joined([part.sums[key] for part in parts]) for key in keys}
    pairs = {key[0].frames: len(each.blocks) for key, each in sums.items()}
    replicates = {frames: Replicates(count, settings.seed) for frames, count in pairs.items()}
    errors, best = [], []
    for (pooling, flux, group, method), each in sums.items():
        if (interval := replicates[pooling.frames].interval(each)) is not None:
            case = pooling.record(flux)
            errors.append(MeanError(**case, group=group, method=method, **interval._asdict()))
    for pooling, flux, group in dict.fromkeys(key[:3] for key in keys):
        names = (*settings.methods, STILL)
        own = {name: sums[pooling, flux, group, name] for name in names}
        if (found := replicates[pooling.frames].best(own)) is not None:
            best.append(BestMethod(**pooling.record(flux), group=group, **found._asdict()))
    finest, first = settings.finest, settings.fluxes[0]
    orders = [
        Order(photons_per_frame=flux, group=group, better=better, worse=worse)
        for flux in settings.fluxes
        for group in dict.fromkeys(name for opposed in OPPOSED for name in opposed[:2])
        for better, worse in replicates[finest.frames].order(
            {name: sums[finest, flux, group, name] for name in settings.methods}
        )
    ]
    return Ranking(
        settings=settings,
        sequences=tuple(each.sequence for each in datasets),
        frames=sum(each.configuration.trajectory.frames for each in datasets),
        photons_per_lux_s=float(np.mean([part.photons_per_lux_s for part in parts])),
        blocks={
            group: int(each.blocks.sum())
            for (pooling, flux, group, name), each in sums.items()
            if (pooling, flux, name) == (finest, first, STILL)
        },
        errors=tuple(errors),
        best=tuple(best),
        orders=tuple(orders),
        consistency=tuple(
            Consistency(
                **pooling.record(flux),
                method=method,
                error=_number([part.consistency[pooling, flux, method] for part in parts]),
            )
            for pooling, flux, method in parts[0].consistency
        ),
        camera=tuple(
            _camera_motion(flux, name, [each for part in parts for each in part.camera[flux, name]])
            for flux, name in parts[0].camera
        ),
        yaw_rates=typical([part.yaw for part in parts]),
    )


def _camera_motion(flux: float, method: str, found: Sequence[CameraErrors]) -> CameraMotionError:
    rotation, heading = np.array(found, np.float64).reshape(-1, 2).T
    return CameraMotionError(
        photons_per_frame=flux,
        method=method,
        rotation_deg=_number(rotation),
        heading_deg=_number(heading),
    )


def _number(values: Sequence[float] | Floats) -> float | None:
    """Median of what is defined, None where nothing is."""
    known = np.array(values)[~np.isnan(values)]
    return float(np.median(known)) if known.size else None
