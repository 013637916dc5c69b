"""The benchmark of flow methods on rendered sequences with true motion."""

from collections.abc import Sequence
from pathlib import Path

from megalopta.benchmark.camera_motion import LIKELIHOODS
from megalopta.benchmark.measured import Example, grid_of, measured
from megalopta.benchmark.methods import Methods
from megalopta.benchmark.ranking_record import Ranking
from megalopta.benchmark.ranking_settings import RankingSettings
from megalopta.benchmark.total import summed_up
from megalopta.benchmark.velocities import Velocities, draws
from megalopta.benchmark.yaw_rate import directional_methods, yaw_errors
from megalopta.core.progress import progress
from megalopta.dataset.store import Dataset


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
    each_flux = 2 * len(wide) + (len(LIKELIHOODS) if settings.camera_pairs else 0)
    clips = len(methods) * sum(1 for _ in draws(settings)) + each_flux * len(settings.fluxes)
    with progress("Ranking methods", len(datasets) * clips, "clip") as advance:
        parts = []
        for dataset in datasets:
            velocities = Velocities(dataset, settings, folder / dataset.sequence, advance)
            yaw = yaw_errors(dataset, settings, wide, velocities)
            parts.append(measured(dataset, settings, methods, velocities, yaw))
    return summed_up(datasets, settings, parts), parts[0].example


def _check(dataset: Dataset, settings: RankingSettings, methods: Methods) -> None:
    frames, fewest = dataset.configuration.trajectory.frames, max(settings.frames_pooled)
    if frames < 3 * fewest:
        raise ValueError(
            f"{dataset.sequence} has {frames} frames: frames_pooled {fewest} needs {3 * fewest}"
        )
    for name, method in methods.items():
        for pixels in settings.pixels_pooled:
            try:
                grid_of(dataset, method, pixels)
            except ValueError as problem:
                raise ValueError(f"pixels_pooled {pixels} for {name}: {problem}") from None
