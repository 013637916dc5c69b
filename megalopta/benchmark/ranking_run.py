"""Rank methods on the sequences of a folder: from frames to the long table, its page and files.

Photons are drawn on perfect pixels from the rendered light, with one scale for all frames. A
block's error is its endpoint error in px per frame; one without velocity counts as zero motion.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from megalopta.benchmark import methods as benchmarked, ranking as ranked, table
from megalopta.benchmark.curves import BOUND, STILL
from megalopta.benchmark.ranking_page import caution, write_ranking
from megalopta.config.yaml_model import validated
from megalopta.core.array_store import ArrayStore
from megalopta.core.arrays import Floats, Mask
from megalopta.core.errors import UserError, refused_as
from megalopta.core.folders import locked
from megalopta.core.freshness import code_digest, digest
from megalopta.core.progress import progress, say, step, working
from megalopta.dataset.frames import read_radiance_frames, read_truth_frame
from megalopta.dataset.store import Dataset, Tree
from megalopta.flow.detectors.blocks import BlockDetector, BlockGrid
from megalopta.flow.detectors.registry import Method
from megalopta.flow.metrics import endpoint_error, translation_bound
from megalopta.flow.stimuli.photons import draw_counts
from megalopta.sensor import PRESETS, photon_rate
from megalopta.stages.noise_warning import variances
from megalopta.stages.run import require

FOLDER = "ranking"
"""Folder of the demo's ranking, inside its dataset"""
_EDGE_RATIO = 1.25
_EDGE_SHARE = 0.05

Rows: TypeAlias = Iterator[tuple[Any, ...]]
"""Rows of `table.samples`"""


@step("ranking")
def run_ranking(
    root: str | Path,
    out: str | Path,
    settings: Mapping[str, str] | None = None,
    methods: Sequence[Method] = (),
) -> Path:
    """Rank flow methods on a rendered dataset, of one sequence or many; return the page.

    Settings are values of `RankingSettings` by name, as YAML. `methods`, also detectors or
    functions of two frames, replace theirs. Velocities are kept in OUT/velocities for the next run.
    Raises UserError if frames are missing, too few or too small, or a setting is wrong.
    """
    root, out = Path(root), Path(out)
    chosen = validated(ranked.RankingSettings, {}, "settings", dict(settings or {}))
    tree = Tree(root)
    tree.check()
    datasets = [tree.opened(name) for name in tree.names()]
    if not datasets:
        raise UserError(f"{root}: no finished sequence; run: {tree.make_again}")
    if len(datasets) == 1:
        require(datasets[0], "render")
    with locked(out), refused_as():
        names = methods or chosen.methods
        detectors, against = benchmarked.with_compared(names, chosen.against)
        chosen = chosen.model_copy(update={"methods": tuple(detectors), "against": against})
        return write_ranking(out, _ranked(datasets, chosen, detectors, out / "velocities"))


def _ranked(
    datasets: Sequence[Dataset],
    settings: ranked.RankingSettings,
    methods: benchmarked.Methods,
    folder: Path,
) -> ranked.Ranking:
    """Measure every metric on every sequence; computed velocities are kept in a folder."""
    for dataset in datasets:  # refused before the work
        dataset.require_truth()
        name, frames = dataset.sequence, dataset.configuration.trajectory.frames
        if frames < 3:
            raise ValueError(f"{name} has {frames} frames; give 3 or more")
        for method in methods.values():
            method.grid(dataset.configuration.camera.shape)
    rates, equal = [], []
    for dataset in datasets:
        light, configuration = perfect_light(dataset), dataset.configuration
        rates.append(light.sum(axis=(1, 2)).mean() / configuration.light.resolved().illuminance_lux)
        if noise := dataset.read_scene_record().get("monte_carlo"):
            ideal, scale = PRESETS["ideal"], np.ones(len(noise["mean"]))
            rendering, shot, _ = variances(noise, configuration, ideal, scale)
            if rendering > 0:
                equal.append(shot / rendering * light.mean() * ideal.exposure_s)
    per_lux_s = float(np.mean(rates))
    levels = (
        ranked.photons_at(per_lux_s, level, settings.exposure_s) for level in settings.light_levels
    )
    frame_px = math.prod(datasets[0].configuration.camera.shape)
    replaced = settings.photons and "fluxes" not in settings.model_fields_set
    stated = () if replaced else settings.fluxes
    fluxes = tuple(sorted({*stated, *levels, *(frame_px * count for count in settings.photons)}))
    facts = ranked.RankingFacts(
        settings=settings.model_copy(update={"fluxes": fluxes}),
        sequences=tuple(dataset.sequence for dataset in datasets),
        frames=sum(dataset.configuration.trajectory.frames for dataset in datasets),
        frame_px=frame_px,
        photons_per_lux_s=per_lux_s,
        rendering_photons_per_px=min(equal, default=None),
        blocks={},
    )
    rows: list[tuple[Any, ...]] = []
    segments = 1 if len(datasets) >= ranked.FEWEST_SEQUENCES else ranked.SEGMENTS
    total = len(methods) * len(fluxes) * len(datasets)
    drawn = (Photons(dataset, settings.seed, folder / dataset.sequence) for dataset in datasets)
    first = next(drawn)
    with working("Compiling and trying the methods"):  # before time is measured
        for method in methods.values():
            benchmarked.check_gives_flow(method, first.velocities(method, fluxes[-1], 0))
    if warning := caution(facts):
        say(warning)
    with progress("Ranking methods", total, "run") as advance:
        for dataset, photons in zip(datasets, chain([first], drawn), strict=True):
            rows += endpoint_errors(dataset, photons, methods, facts.settings, segments, advance)
    samples = table.samples(rows)
    still = samples.query("metric == @table.MEAN and method == @STILL")
    blocks = still[still["photons"] == fluxes[0]].groupby("group", sort=False)["blocks"].sum()
    facts = facts.model_copy(update={"blocks": blocks.astype(int).to_dict()})
    return ranked.Ranking(facts, table.means(samples, BOUND, settings.against), samples)


class BlockTruth(NamedTuple):
    """Truth of the inner blocks (pairs, rows, columns) of a sequence."""

    velocities: Floats
    """(..., 2) in px per frame; NaN where unknown"""
    groups: Mapping[str, Mask]
    """Blocks of each group"""


def sequence_truth(dataset: Dataset, grid: BlockGrid) -> BlockTruth:
    """Return the true motion of the inner blocks of a grid, and the groups that they are in."""
    camera, poses = dataset.configuration.camera, dataset.configuration.trajectory.poses()
    directions, pairs = camera.directions(), []
    for index in range(len(poses) - 1):
        turn = poses[index + 1, :3, :3].T @ poses[index, :3, :3]
        turned = camera.displacement(directions @ turn.T)
        pairs.append(_block_means(read_truth_frame(dataset, index), turned, grid))
    means = {name: np.stack([pair[name] for pair in pairs])[:, 1:-1, 1:-1] for name in pairs[0]}
    speed = np.linalg.norm(means["velocity"], axis=-1)
    groups = {
        "all": np.isfinite(speed),
        "visible": means["hidden"] < endpoint_error.OCCLUDED_SHARE,
        "occluded": means["hidden"] >= endpoint_error.OCCLUDED_SHARE,
        "smooth": means["edges"] < _EDGE_SHARE,
        "depth edge": means["edges"] >= _EDGE_SHARE,
    }
    fast = np.digitize(speed, ranked.SPEEDS_PX)
    near = np.digitize(means["parallax"], ranked.PARALLAX_PX)
    groups |= {f"speed {name}": fast == at for at, name in enumerate(ranked.RANGES)}
    groups |= {f"parallax {name}": near == at for at, name in enumerate(ranked.RANGES)}
    groups = {name: blocks & groups["all"] for name, blocks in groups.items()}
    return BlockTruth(means["velocity"], groups)


def _block_means(truth: Any, turned: Floats, grid: BlockGrid) -> dict[str, Floats]:
    """Means over the blocks (rows, columns) of a pair; `turned`: flow by the camera's rotation."""
    flow, hidden, depth = truth.flow_forward[None], truth.occluded_forward[None], truth.depth
    velocity = endpoint_error.block_flow(flow, grid, hidden)[0]
    rotation = endpoint_error.block_flow(turned[None], grid, hidden)[0]

    # edges: a right or lower neighbor is a quarter farther or nearer
    log = np.log(np.where(np.isfinite(depth), depth, 1e6))
    edges = np.zeros(depth.shape, np.bool_)
    edges[:, :-1] |= np.abs(np.diff(log, axis=1)) > np.log(_EDGE_RATIO)
    edges[:-1] |= np.abs(np.diff(log, axis=0)) > np.log(_EDGE_RATIO)

    return {
        "velocity": velocity,
        "parallax": np.linalg.norm(velocity - rotation, axis=-1),
        "hidden": endpoint_error.block_share(hidden, grid)[0],
        "edges": endpoint_error.block_share(edges[None], grid)[0],
    }


def perfect_light(dataset: Dataset) -> Floats:
    """Return photons per second on each perfect pixel (T, H, W)."""
    bands = dataset.configuration.render.bands_nm
    parts = [
        photon_rate(radiance, bands, PRESETS["ideal"])
        for _, radiance in read_radiance_frames(dataset)
    ]
    return np.concatenate(parts).astype(np.float64)


class Photons:
    """Photon draws of a sequence, and the velocities that methods find in them.

    Velocities are kept in a folder, under the hash of all that they depend on.
    """

    def __init__(self, dataset: Dataset, seed: int, folder: Path) -> None:
        light = perfect_light(dataset)
        self._mean = light / light.sum(axis=(1, 2)).mean()
        self._sequence, self._seed = dataset.sequence, seed
        used = "megalopta.flow", "megalopta.sensor.sampling", "megalopta.scenes.cameras"
        self._folder = folder / code_digest(*used, __name__)[:12]
        self._light_hash = digest(light.tobytes(), repr(seed))

    def means(self, flux: float) -> Floats:
        """Return mean photons of each pixel (T, H, W) at `flux` photons per frame."""
        return np.asarray(self._mean * flux)

    def velocities(self, method: BlockDetector, flux: float, repeat: int) -> Floats:
        """Return velocities (pairs, rows, columns, 2) of all blocks in one draw, px per frame."""
        key = digest(self._light_hash, benchmarked.identity(method), repr((flux, repeat)))
        store = ArrayStore(self._folder, key)
        if (kept := store.read(["velocities"])) is None:
            means = self.means(flux)
            stream = self._sequence, "1 × 1 px, 1 frame", str(flux), str(repeat)
            counts = draw_counts(means, self._seed, *stream)
            velocities = method.respond(counts, 1 / means.mean())
            store.write(kept := {"velocities": velocities.astype(np.float32)})
        return kept["velocities"].astype(np.float64)


def endpoint_errors(
    dataset: Dataset,
    photons: Photons,
    methods: benchmarked.Methods,
    settings: ranked.RankingSettings,
    segments: int,
    advance: Callable[[int], object],
) -> Rows:
    """Yield errors of every method and of zero motion, by group, and the Poisson bound.

    The bound is the least mean endpoint error that the photons of a pair allow in a block,
    √(π/4 · trace) of the Cramér–Rao covariance for two frames, exact if that is isotropic; or the
    motion, if that is less.
    """
    truth_of = cache(lambda grid: sequence_truth(dataset, grid))
    grids = [method.grid(dataset.configuration.camera.shape) for method in methods.values()]

    def rows(name: str, flux: float, errors: Sequence[Floats], truth: BlockTruth) -> Rows:
        for metric, group, segment, *sums in _by_group(errors, truth, segments):
            if name != BOUND or metric == table.MEAN:
                yield metric, name, flux, group, f"{dataset.sequence} {segment}", *sums

    for flux in settings.fluxes:
        for grid, (name, method) in zip(grids, methods.items(), strict=True):
            truth, errors = truth_of(grid), []
            for repeat in range(settings.repeats if name != STILL else 0):
                velocities = photons.velocities(method, flux, repeat)[:, 1:-1, 1:-1]
                errors.append(np.linalg.norm(velocities - truth.velocities, axis=-1))
            if errors:
                yield from rows(name, flux, errors, truth)
            advance(1)
        truth = truth_of(grids[0])
        speed = np.linalg.norm(truth.velocities, axis=-1)
        means = photons.means(flux)[:-1]
        known = [translation_bound.fisher_information(frame, grids[0]) for frame in means]
        least = translation_bound.cramer_rao_covariance(np.array(known))
        trace = np.trace(least, axis1=-2, axis2=-1)[:, 1:-1, 1:-1]
        yield from rows(STILL, flux, [speed], truth)
        yield from rows(BOUND, flux, [np.minimum(np.sqrt(np.pi / 4 * trace), speed)], truth)


def _by_group(errors: Sequence[Floats], truth: BlockTruth, segments: int) -> Rows:
    """Yield metric, group, segment, total and blocks of errors (pairs, rows, columns) of draws.

    An error that is not finite, without a velocity, becomes that of zero motion.
    """
    speed = np.linalg.norm(truth.velocities, axis=-1)
    missing = [~np.isfinite(error) for error in errors]
    errors = [np.where(none, speed, error) for none, error in zip(missing, errors, strict=True)]
    for group, inside in truth.groups.items():
        totals = np.sum([np.where(inside, error, 0).sum(axis=(1, 2)) for error in errors], axis=0)
        blocks = len(errors) * inside.sum(axis=(1, 2)).astype(np.float64)
        measured = [(table.MEAN, totals, blocks)]
        if group == "all":
            shares = {table.FAR: [error > table.FAR_PX for error in errors], table.NONE: missing}
            medians = [
                np.median([error[pair][known] for error in errors]) if known.any() else 0.0
                for pair, known in enumerate(inside)
            ]
            for metric, masks in shares.items():
                of_pairs = np.sum([mask & inside for mask in masks], axis=(0, 2, 3))
                measured.append((metric, of_pairs.astype(float), blocks))
            measured.append((table.MEDIAN, np.array(medians), (blocks > 0).astype(np.float64)))
        for metric, *sums in measured:
            parts = zip(*(np.array_split(values, segments) for values in sums), strict=True)
            for segment, (total, count) in enumerate(parts):
                yield metric, group, segment, total.sum(), count.sum()
