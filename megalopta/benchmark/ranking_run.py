"""Rank methods on the sequences of a folder: from frames to the long table, its page and files."""

import math
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path

import numpy as np

from megalopta.benchmark.methods import Methods, directional_methods, velocity_methods
from megalopta.benchmark.ranked_sequence import LIKELIHOODS, RankedSequence, photons_per_lux_s
from megalopta.benchmark.ranking import Ranking, group_blocks, ranking_rows
from megalopta.benchmark.ranking_page import write_ranking
from megalopta.benchmark.ranking_settings import NO_POOLING, Pooling, RankingSettings, photons_at
from megalopta.benchmark.sequence_errors import METRICS, Example, example_of
from megalopta.config.yaml_model import validated
from megalopta.core import bounded
from megalopta.core.errors import UserError, refused_as
from megalopta.core.folders import locked
from megalopta.core.format_numbers import check_format
from megalopta.core.progress import progress
from megalopta.dataset.store import Dataset, Tree
from megalopta.flow.detectors.registry import Method
from megalopta.stages.run import require

FOLDER = "ranking"
"""Folder of the demo's ranking, inside its dataset"""


def read_ranking(folder: Path) -> Ranking | None:
    """Read a ranking written by `run_ranking`; None if there is none. Raises UserError."""
    path = folder / "ranking.json"
    if not path.exists():
        return None
    with bounded.undamaged(path, "remove it, or rank the methods again"):
        values = bounded.read_json(path)
        check_format("ranking", values, path)
        return Ranking.model_validate(values)


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
    with locked(out):
        with refused_as():
            ranked = velocity_methods(methods or chosen.methods)
            chosen = _with_levels(chosen.model_copy(update={"methods": tuple(ranked)}), datasets)
            ranking, example = _ranked(datasets, chosen, ranked, out / "velocities")
        return write_ranking(out, ranking, example)


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


def _with_levels(settings: RankingSettings, datasets: Sequence[Dataset]) -> RankingSettings:
    """Add the photons per frame of the light levels to the fluxes."""
    if not settings.light_levels:
        return settings
    per_lux = float(np.mean([photons_per_lux_s(each) for each in datasets]))
    found = [photons_at(per_lux, each, settings.exposure_s) for each in settings.light_levels]
    return settings.model_copy(update={"fluxes": tuple(sorted({*settings.fluxes, *found}))})


def _ranked(
    datasets: Sequence[Dataset], settings: RankingSettings, methods: Methods, folder: Path
) -> tuple[Ranking, Example]:
    """Measure every metric on every sequence; computed velocities are kept in a folder."""
    work = sum(_work(dataset, settings, methods) for dataset in datasets)
    parts, lights = [], []
    examples: list[Example] = []
    with progress("Ranking methods", work, "clip") as advance:
        for dataset in datasets:
            own = folder / dataset.sequence
            sequence = RankedSequence(dataset, settings, methods, own, advance)
            # all methods in turn, the slow ones first, so that the time left can be told
            for pooling, flux in product(settings.poolings, settings.fluxes):
                for name in reversed(list(methods)):
                    sequence.noisy(name, pooling, flux)
            parts.append(dict(each for metric in METRICS for each in metric(sequence)))
            lights.append(sequence.photons_per_lux_s)
            examples = examples or [example_of(sequence)]
    blocks = group_blocks(parts, settings)
    ranking = Ranking(
        settings=settings,
        sequences=tuple(each.sequence for each in datasets),
        frames=sum(each.configuration.trajectory.frames for each in datasets),
        frame_px=math.prod(datasets[0].configuration.camera.shape),
        photons_per_lux_s=float(np.mean(lights)),
        blocks=blocks,
        rows=tuple(ranking_rows(parts, settings, blocks)),
    )
    return ranking, examples[0]


def _work(dataset: Dataset, settings: RankingSettings, methods: Methods) -> int:
    """Return the number of clips to measure, after checking that they can be."""
    dataset.require_truth()
    frames, fewest = dataset.configuration.trajectory.frames, max(settings.frames_pooled)
    if frames < 3 * fewest:
        raise ValueError(
            f"{dataset.sequence} has {frames} frames: frames_pooled {fewest} needs {3 * fewest}"
        )
    camera = dataset.configuration.camera
    for name, method in methods.items():
        for pixels in settings.pixels_pooled:
            try:
                method.grid(Pooling(pixels, 1).shape((camera.height, camera.width)))
            except ValueError as problem:
                raise ValueError(f"pixels_pooled {pixels} for {name}: {problem}") from None
    repeats = range(settings.repeats)
    clips: set[tuple[object, ...]] = set(
        product(methods, settings.poolings, settings.fluxes, repeats)
    )
    wide = directional_methods(methods, settings.wide_field)
    clips |= set(product(wide, (NO_POOLING,), settings.fluxes, (None, 0)))
    return len(clips) + len(settings.fluxes) * len(LIKELIHOODS) * (settings.camera_pairs > 0)
