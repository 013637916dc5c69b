"""Errors of methods on one rendered sequence: rows of the long table, by group of blocks.

Photons are drawn on perfect pixels from the rendered light, with one scale for all frames; all
methods see the same draws. A block's error is its endpoint error in px of the full image per frame;
a block without velocity counts as zero motion.

Groups show where a ranking changes: blocks hidden in the next frame, depth edges, image speed,
distance, and parallax, the motion that remains without the camera's rotation.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from megalopta.benchmark import methods as benchmarked, ranking
from megalopta.benchmark.ranking import RANGES, Pooling, RankingSettings, at_speed
from megalopta.core.array_store import ArrayStore
from megalopta.core.arrays import Floats, Mask
from megalopta.core.freshness import code_digest, digest
from megalopta.dataset.frames import read_radiance_frames, read_truth_frames
from megalopta.dataset.store import Dataset
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.metrics import endpoint_error, translation_bound
from megalopta.flow.stimuli.photons import draw_counts
from megalopta.sensor import PRESETS, photon_rate

SPEEDS_PX = (1.0, 3.0)
PARALLAX_PX = (0.3, 1.0)
DISTANCES_M = (5.0, 20.0)
"""Limits between low, medium and high"""
FAR_PX = 3.0
_EDGE_RATIO = 1.25
_EDGE_SHARE = 0.05
_TURNING_PX = 0.01
"""Largest parallax of a sequence of rotation alone, in which nothing moves"""

_NO_LIMIT = 2**62

Rows: TypeAlias = Iterator[tuple[Any, ...]]
"""Rows of `table.samples`"""


class BlockTruths(NamedTuple):
    """Truth of the inner blocks (pairs, rows, columns) of a sequence at one pooling."""

    velocities: Floats
    """(..., 2) in px of the full image per frame; NaN where unknown"""
    groups: Mapping[str, Mask]
    """Blocks of each group"""


class SequenceTruth:
    """Truth of a sequence on the finest blocks, read once; `at` pools it over frames."""

    def __init__(self, dataset: Dataset, grid: BlockGrid) -> None:
        camera, trajectory = dataset.configuration.camera, dataset.configuration.trajectory
        poses, directions, facts = trajectory.poses(), camera.directions(), []
        for index, truth in enumerate(read_truth_frames(dataset)):
            if index + 1 < len(poses):
                turn = poses[index + 1, :3, :3].T @ poses[index, :3, :3]
                facts.append(_facts(truth, camera.displacement(directions @ turn.T), grid))
        self._frames = trajectory.frames
        self._facts = {name: np.stack([pair[name] for pair in facts]) for name in facts[0]}
        parallax = self._facts["parallax"]
        self._only_turns = bool((parallax[np.isfinite(parallax)] < _TURNING_PX).all())

    def at(self, pooling: Pooling) -> BlockTruths:
        """Return the truth between pooled frames."""
        steps = list(pooling.steps(self._frames))
        mean = {
            name: np.stack([values[step].mean(axis=0) for step in steps])[:, 1:-1, 1:-1]
            for name, values in self._facts.items()
        }
        return BlockTruths(mean["velocity"], _groups(mean, self._only_turns))


def _facts(truth: Any, turned: Floats, grid: BlockGrid) -> dict[str, Floats]:
    """Means over the blocks (rows, columns) of one pair of frames.

    `truth` is a `render.Truth`; `turned` the flow by the camera's rotation alone.
    """
    flow, hidden, depth = truth.flow_forward[None], truth.occluded_forward[None], truth.depth
    to_full = np.array(depth.shape[::-1]) / np.array(grid.shape[::-1])
    velocity = endpoint_error.block_flow(flow, grid, hidden)[0] * to_full
    rotation = endpoint_error.block_flow(turned[None], grid, hidden)[0] * to_full

    # edges: a right or lower neighbor is a quarter farther or nearer
    log = np.log(np.where(np.isfinite(depth), depth, 1e6))
    edges = np.zeros(depth.shape, np.bool_)
    edges[:, :-1] |= np.abs(np.diff(log, axis=1)) > np.log(_EDGE_RATIO)
    edges[:-1] |= np.abs(np.diff(log, axis=0)) > np.log(_EDGE_RATIO)

    # distance: the inverse of the mean inverse depth
    inverse = np.where(depth > 0, 1 / depth.astype(np.float64), 0)
    nearness = endpoint_error.block_flow(np.dstack([inverse, inverse])[None], grid)[0, ..., 0]
    nearness *= depth.shape[1] / grid.shape[1]  # unlike a flow
    with np.errstate(divide="ignore"):
        distance = np.asarray(1 / nearness)
    return {
        "velocity": velocity,
        "parallax": np.linalg.norm(velocity - rotation, axis=-1),
        "hidden": endpoint_error.block_share(hidden, grid)[0],
        "edges": endpoint_error.block_share(edges[None], grid)[0],
        "distance": distance,
    }


def _groups(facts: Mapping[str, Floats], only_turns: bool) -> dict[str, Mask]:
    speed = np.linalg.norm(facts["velocity"], axis=-1)
    known = np.isfinite(speed)
    hidden = facts["hidden"] >= endpoint_error.OCCLUDED_SHARE
    seen = facts["hidden"] < endpoint_error.OCCLUDED_SHARE
    groups = {
        "all": known,
        "visible": seen,
        "occluded": hidden,
        "smooth": facts["edges"] < _EDGE_SHARE,
        "depth edge": facts["edges"] >= _EDGE_SHARE,
    }
    kinds = (
        ("speed", speed, SPEEDS_PX),
        ("parallax", facts["parallax"], PARALLAX_PX),
        ("distance", facts["distance"], DISTANCES_M),
    )
    for kind, values, bounds in kinds:
        place = np.digitize(values, bounds)
        groups |= {f"{kind} {name}": place == at for at, name in enumerate(RANGES)}
    for name in RANGES:
        here = groups[f"speed {name}"]
        for parallax in RANGES:
            groups[cell_name(name, parallax)] = here & groups[f"parallax {parallax}"]
        groups |= {
            at_speed(name, ranking.ALONE): here & seen & only_turns,
            at_speed(name, ranking.LITTLE): here & seen & groups["parallax low"] & (not only_turns),
            at_speed(name, ranking.MUCH): here & seen & groups["parallax high"],
            at_speed(name, ranking.HIDDEN): here & hidden & (not only_turns),
        }
    return {name: among & known for name, among in groups.items()}


def cell_name(speed: str, parallax: str) -> str:
    """Name of the group of one cell of the atlas."""
    return f"speed {speed}, parallax {parallax}"


class Drawn(NamedTuple):
    """A photon draw of a sequence."""

    pooling: Pooling
    flux: float
    """Photons per frame, before pooling of frames"""
    repeat: int


class RankedSequence:
    """A sequence, its ground truth, and velocities of methods, which are kept in a folder."""

    def __init__(
        self,
        dataset: Dataset,
        settings: RankingSettings,
        methods: benchmarked.Methods,
        folder: Path,
    ) -> None:
        self.dataset, self.settings, self.methods = dataset, settings, methods
        self.camera, self.trajectory = (
            dataset.configuration.camera,
            dataset.configuration.trajectory,
        )
        self.light = perfect_light(dataset)
        used = "megalopta.flow", "megalopta.sensor.sampling", "megalopta.scenes.cameras"
        self._folder = folder / code_digest(*used, __name__)[:12]
        self._key = digest(self.light.tobytes(), repr(settings.seed))
        self._pooled: dict[Pooling, Floats] = {}
        traced = cache(lambda grid: SequenceTruth(dataset, grid))
        self.truth = cache(lambda grid, pooling: traced(grid).at(pooling))
        """The `BlockTruths` of the blocks of a grid between pooled frames"""

    def grid(self, name: str, pixels: int) -> BlockGrid:
        """Return the blocks of a method on pooled frames; ValueError if these are too small."""
        return self.methods[name].grid(Pooling(pixels, 1).shape(self.camera.shape))

    def noisy(self, name: str, pooling: Pooling, flux: float) -> list[Floats]:
        """Return the velocities by a method in each photon draw."""
        draws = (Drawn(pooling, flux, repeat) for repeat in range(self.settings.repeats))
        return [self._velocities(name, drawn) for drawn in draws]

    def _velocities(self, name: str, drawn: Drawn) -> Floats:
        """Velocities (pairs, rows, columns, 2) of all blocks, px of the full image per frame."""
        method, pooling = self.methods[name], drawn.pooling
        what = digest(self._key, benchmarked.identity(method), repr(drawn))
        store = ArrayStore(self._folder, what, _NO_LIMIT)
        if (kept := store.read(["found"])) is None:
            means = self.means(pooling, drawn.flux)
            counts = draw_counts(means, self.settings.seed, self.dataset.sequence, *map(str, drawn))
            found = method.respond(counts, 1 / means.mean()) * (pooling.pixels / pooling.frames)
            store.write(kept := {"found": found.astype(np.float32)})
        return kept["found"].astype(np.float64)

    def means(self, pooling: Pooling, flux: float) -> Floats:
        """Mean photons on each pixel of pooled frames (T, H, W)."""
        if pooling not in self._pooled:
            light = pooling.light(self.light)
            self._pooled = {pooling: light / light.sum(axis=(1, 2)).mean()}
        return self._pooled[pooling] * (flux * pooling.frames)


def perfect_light(dataset: Dataset) -> Floats:
    """Return photons per second on each perfect pixel (T, H, W)."""
    bands = dataset.configuration.render.bands_nm
    parts = [
        photon_rate(radiance, bands, PRESETS["ideal"])
        for _, radiance in read_radiance_frames(dataset)
    ]
    return np.concatenate(parts).astype(np.float64)


def endpoint_errors(
    sequence: RankedSequence, segments: int, advance: Callable[[int], object]
) -> Rows:
    """Yield errors of every method and of zero motion, by group, and the Poisson bound.

    The bound is the least mean endpoint error that the photons of a pair allow in a block,
    √(π/4 · trace) of the Cramér–Rao covariance for two frames, exact if that is isotropic; or the
    motion, if that is less.
    """
    settings, unit = sequence.settings, sequence.dataset.sequence
    for pooling, flux in product(settings.poolings, settings.fluxes):
        for name in sequence.methods:
            truth = sequence.truth(sequence.grid(name, pooling.pixels), pooling)
            inside = [flow[:, 1:-1, 1:-1] for flow in sequence.noisy(name, pooling, flux)]
            known = [np.isfinite(flow).all(axis=-1, keepdims=True) for flow in inside]
            there = [np.where(*pair, 0) for pair in zip(known, inside, strict=True)]
            errors = [np.linalg.norm(flow - truth.velocities, axis=-1) for flow in there]
            for metric, group, *sums in _by_group(errors, truth, segments):
                yield metric, name, flux, group, *pooling, f"{unit} {sums[0]}", *sums[1:]
            advance(1)
        grid = sequence.grid(next(iter(sequence.methods)), pooling.pixels)
        truth = sequence.truth(grid, pooling)
        speed = np.linalg.norm(truth.velocities, axis=-1)
        least = [
            translation_bound.cramer_rao_covariance(
                translation_bound.fisher_information(each, grid)
            )
            for each in sequence.means(pooling, flux)[:-1]
        ]
        trace = np.trace(np.array(least), axis1=-2, axis2=-1)[:, 1:-1, 1:-1]
        bound = np.sqrt(np.pi / 4 * trace) * pooling.pixels / pooling.frames
        for name, errors in (
            (ranking.STILL, [speed]),
            (ranking.BOUND, [np.minimum(bound, speed)]),
        ):
            for metric, group, *sums in _by_group(errors, truth, segments):
                if metric == ranking.MEAN or name == ranking.STILL:
                    yield metric, name, flux, group, *pooling, f"{unit} {sums[0]}", *sums[1:]


def _by_group(errors: Sequence[Floats], truth: BlockTruths, segments: int) -> Rows:
    """Yield metric, group, segment, total and blocks of errors (pairs, rows, columns) of draws."""
    draws = len(errors)
    for group, among in truth.groups.items():
        totals = np.sum([np.where(among, error, 0).sum(axis=(1, 2)) for error in errors], axis=0)
        blocks = draws * among.sum(axis=(1, 2)).astype(np.float64)
        yield from in_segments(ranking.MEAN, group, totals, blocks, segments)
        if group == "all":
            far = np.sum([((error > FAR_PX) & among).sum(axis=(1, 2)) for error in errors], axis=0)
            yield from in_segments(ranking.FAR, group, far.astype(float), blocks, segments)
            medians = [
                np.median([error[pair][there] for error in errors]) if there.any() else 0.0
                for pair, there in enumerate(among)
            ]
            there = (blocks > 0).astype(np.float64)
            yield from in_segments(ranking.MEDIAN, group, np.array(medians), there, segments)


def in_segments(metric: str, group: str, totals: Floats, blocks: Floats, segments: int) -> Rows:
    """Yield the sums over the successive pairs of each segment."""
    parts = zip(np.array_split(totals, segments), np.array_split(blocks, segments), strict=True)
    for segment, (total, count) in enumerate(parts):
        yield metric, group, segment, total.sum(), count.sum()
