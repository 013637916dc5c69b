"""Rank methods on the sequences of a folder: from frames to the long table, its page and files."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from megalopta.benchmark import methods as benchmarked, sequence_errors, table
from megalopta.benchmark.ranking import (
    FEWEST_SEQUENCES,
    MEAN,
    SEGMENTS,
    STILL,
    Pooling,
    Ranking,
    RankingFacts,
    RankingSettings,
    photons_at,
    ranking_rows,
    read_ranking as read_ranking,
)
from megalopta.benchmark.ranking_page import write_ranking
from megalopta.benchmark.sequence_errors import RankedSequence
from megalopta.config.yaml_model import validated
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError, refused_as
from megalopta.core.folders import locked
from megalopta.core.progress import progress
from megalopta.dataset.store import Dataset, Tree
from megalopta.flow.detectors.registry import Method
from megalopta.stages.run import require

FOLDER = "ranking"
"""Folder of the demo's ranking, inside its dataset"""


def run_ranking(
    root: str | Path,
    out: str | Path,
    settings: Mapping[str, str] | None = None,
    methods: Sequence[Method] = (),
) -> Path:
    """Rank flow methods on a rendered dataset, of one sequence or many; return the page.

    Settings are values of `RankingSettings` by name, as YAML. `methods` replaces their methods:
    names, detectors, or functions of two frames (see `megalopta.flow.detector_from`). Velocities
    are kept in OUT/velocities, so that an interrupted run, or one with an additional method,
    continues from there. Raises UserError if frames are missing, too few or too small, or a setting
    is wrong.
    """
    out, chosen = Path(out), validated(RankingSettings, {}, "settings", dict(settings or {}))
    datasets = sequences_of(Path(root))
    with locked(out), refused_as():
        ranked = benchmarked.velocity_methods(methods or chosen.methods)
        chosen = chosen.model_copy(update={"methods": tuple(ranked)})
        return write_ranking(out, _ranked(datasets, chosen, ranked, out / "velocities"))


def sequences_of(root: Path) -> list[Dataset]:
    """Open the rendered sequences of a folder. Raises UserError."""
    tree = Tree(root)
    tree.check()
    datasets = [tree.opened(name) for name in tree.names()]
    if not datasets:
        raise UserError(f"{root}: no finished sequence; run: {tree.make_again}")
    if len(datasets) == 1:
        require(datasets[0], "render")
    return datasets


def _ranked(
    datasets: Sequence[Dataset],
    settings: RankingSettings,
    methods: benchmarked.Methods,
    folder: Path,
) -> Ranking:
    """Measure every metric on every sequence; computed velocities are kept in a folder."""
    for dataset in datasets:
        _check(dataset, settings, methods)
    if settings.light_levels:
        lights = map(sequence_errors.perfect_light, datasets)
        mean = float(np.mean(list(map(_photons_per_lux_s, datasets, lights))))
        levels = (photons_at(mean, each, settings.exposure_s) for each in settings.light_levels)
        fluxes = tuple(sorted({*settings.fluxes, *levels}))
        settings = settings.model_copy(update={"fluxes": fluxes})
    rows: list[tuple[Any, ...]] = []
    per_lux = []
    segments = 1 if len(datasets) >= FEWEST_SEQUENCES else SEGMENTS
    total = len(settings.poolings) * len(methods) * len(settings.fluxes) * len(datasets)
    with progress("Ranking methods", total, "case") as advance:
        for dataset in datasets:
            sequence = RankedSequence(dataset, settings, methods, folder / dataset.sequence)
            per_lux.append(_photons_per_lux_s(dataset, sequence.light))
            rows += sequence_errors.endpoint_errors(sequence, segments, advance)
    samples = table.samples(rows)
    blocks = _group_blocks(samples, settings)
    noise = [dataset.read_scene_record().get("monte_carlo") for dataset in datasets]
    equal = [found["equivalent_photons_per_pixel"] for found in noise if found]
    facts = RankingFacts(
        settings=settings,
        sequences=tuple(dataset.sequence for dataset in datasets),
        frames=sum(dataset.configuration.trajectory.frames for dataset in datasets),
        frame_px=math.prod(datasets[0].configuration.camera.shape),
        photons_per_lux_s=float(np.mean(per_lux)),
        rendering_photons_per_px=min(equal, default=None),
        blocks=blocks,
    )
    return Ranking(facts, ranking_rows(samples, settings, blocks))


def _check(dataset: Dataset, settings: RankingSettings, methods: benchmarked.Methods) -> None:
    """Refuse, before the work, a sequence that is too short or too small."""
    dataset.require_truth()
    frames, fewest = dataset.configuration.trajectory.frames, max(settings.frames_pooled)
    if frames < 3 * fewest:
        raise ValueError(
            f"{dataset.sequence} has {frames} frames: frames_pooled {fewest} needs {3 * fewest}"
        )
    for name, method in methods.items():
        for pixels in settings.pixels_pooled:
            try:
                method.grid(Pooling(pixels, 1).shape(dataset.configuration.camera.shape))
            except ValueError as problem:
                raise ValueError(f"pixels_pooled {pixels} for {name}: {problem}") from None


def _photons_per_lux_s(dataset: Dataset, light: Floats) -> float:
    """Photons of a mean frame on perfect pixels, for each lux and second."""
    return (
        float(light.sum(axis=(1, 2)).mean())
        / dataset.configuration.light.resolved().illuminance_lux
    )


def _group_blocks(samples: pd.DataFrame, settings: RankingSettings) -> dict[str, int]:
    """Return the number of blocks of each group without pooling."""
    pixels, frames = settings.finest
    still = samples[
        (samples["metric"] == MEAN)
        & (samples["method"] == STILL)
        & (samples["photons"] == settings.fluxes[0])
        & (samples["pixels_pooled"] == pixels)
        & (samples["frames_pooled"] == frames)
    ]
    blocks = still.groupby("group", sort=False)["blocks"].sum().astype(int)
    return {str(group): int(count) for group, count in blocks.items()}
