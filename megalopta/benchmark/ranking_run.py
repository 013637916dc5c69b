"""Rank methods on the sequences of a folder: from frames to the long table, its page and files."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from megalopta.benchmark import methods as benchmarked, ranking as ranked, sequence_errors, table
from megalopta.benchmark.ranking import Ranking, RankingFacts, RankingSettings
from megalopta.benchmark.ranking_page import write_ranking
from megalopta.config.yaml_model import validated
from megalopta.core.errors import UserError, refused_as
from megalopta.core.folders import locked
from megalopta.core.progress import progress
from megalopta.dataset.store import Dataset, Tree
from megalopta.flow.detectors.registry import Method
from megalopta.stages.run import require

FOLDER = "ranking"
"""Folder of the demo's ranking, inside its dataset"""
_FEWEST_FRAMES = 3


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
    root, out = Path(root), Path(out)
    chosen = validated(RankingSettings, {}, "settings", dict(settings or {}))
    tree = Tree(root)
    tree.check()
    datasets = [tree.opened(name) for name in tree.names()]
    if not datasets:
        raise UserError(f"{root}: no finished sequence; run: {tree.make_again}")
    if len(datasets) == 1:
        require(datasets[0], "render")
    with locked(out), refused_as():
        detectors = benchmarked.velocity_methods(methods or chosen.methods)
        chosen = chosen.model_copy(update={"methods": tuple(detectors)})
        return write_ranking(out, _ranked(datasets, chosen, detectors, out / "velocities"))


def _ranked(
    datasets: Sequence[Dataset],
    settings: RankingSettings,
    methods: benchmarked.Methods,
    folder: Path,
) -> Ranking:
    """Measure every metric on every sequence; computed velocities are kept in a folder."""
    for dataset in datasets:
        _check(dataset, methods)
    per_lux_s = float(np.mean([_photons_per_lux_s(dataset) for dataset in datasets]))
    levels = (
        ranked.photons_at(per_lux_s, level, settings.exposure_s) for level in settings.light_levels
    )
    fluxes = tuple(sorted({*settings.fluxes, *levels}))
    rows: list[tuple[Any, ...]] = []
    segments = 1 if len(datasets) >= ranked.FEWEST_SEQUENCES else ranked.SEGMENTS
    total = len(methods) * len(fluxes) * len(datasets)
    with progress("Ranking methods", total, "case") as advance:
        for dataset in datasets:
            light = sequence_errors.perfect_light(dataset)
            kept = folder / dataset.sequence
            photons = sequence_errors.Photons(dataset, light, settings.seed, kept)
            rows += sequence_errors.endpoint_errors(
                dataset, photons, methods, fluxes, settings.repeats, segments, advance
            )
    samples = table.samples(rows)
    still = samples[
        (samples["metric"] == table.MEAN)
        & (samples["method"] == sequence_errors.STILL)
        & (samples["photons"] == fluxes[0])
    ]
    blocks = still.groupby("group", sort=False)["blocks"].sum().astype(int)
    noise = [dataset.read_scene_record().get("monte_carlo") for dataset in datasets]
    equal = [record["equivalent_photons_per_pixel"] for record in noise if record]
    facts = RankingFacts(
        settings=settings.model_copy(update={"fluxes": fluxes}),
        sequences=tuple(dataset.sequence for dataset in datasets),
        frames=sum(dataset.configuration.trajectory.frames for dataset in datasets),
        frame_px=math.prod(datasets[0].configuration.camera.shape),
        photons_per_lux_s=per_lux_s,
        rendering_photons_per_px=min(equal, default=None),
        blocks={str(group): int(count) for group, count in blocks.items()},
    )
    return Ranking(facts, table.means(samples, sequence_errors.BOUND))


def _check(dataset: Dataset, methods: benchmarked.Methods) -> None:
    """Refuse, before the work, a sequence that is too short or too small."""
    dataset.require_truth()
    frames, shape = dataset.configuration.trajectory.frames, dataset.configuration.camera.shape
    if frames < _FEWEST_FRAMES:
        raise ValueError(f"{dataset.sequence} has {frames} frames; give {_FEWEST_FRAMES} or more")
    for name, method in methods.items():
        try:
            method.grid(shape)
        except ValueError as problem:
            raise ValueError(f"{dataset.sequence} for {name}: {problem}") from None


def _photons_per_lux_s(dataset: Dataset) -> float:
    """Photons of a mean frame on perfect pixels, for each lux and second."""
    photons = sequence_errors.perfect_light(dataset).sum(axis=(1, 2)).mean()
    return float(photons) / dataset.configuration.light.resolved().illuminance_lux
