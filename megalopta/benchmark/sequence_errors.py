"""Errors of methods on one rendered sequence: rows of the long table, by group of blocks.

Photons are drawn on perfect pixels from the rendered light, with one scale for all frames; all
methods see the same draws. A block's error is its endpoint error in px of the full image per frame;
a block without velocity counts as zero motion. The weights of a yaw rate are learned from the light
itself, at the same number of photons but without noise.

Groups show where a ranking changes: blocks hidden in the next frame, depth edges, image speed,
distance, and parallax, the motion that remains without the camera's rotation.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from megalopta.benchmark import methods as benchmarked, ranking
from megalopta.benchmark.ranking import NO_POOLING, RANGES, Pooling, RankingSettings, at_speed
from megalopta.core.array_store import ArrayStore
from megalopta.core.arrays import Floats, Mask
from megalopta.core.freshness import code_digest, digest
from megalopta.dataset.frames import read_radiance_frames, read_truth_frames
from megalopta.dataset.store import Dataset
from megalopta.flow.benchmark.settings import default_warm_up
from megalopta.flow.detectors.base import Detector
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.egomotion import camera_motion, wide_field
from megalopta.flow.egomotion.motion_of_flow import motion_of_flow
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
_STILL_M = 1e-9
_TURNING_PX = 0.01
"""Largest parallax of a sequence of rotation alone, in which nothing moves"""

LIKELIHOODS: Mapping[str, int] = MappingProxyType(
    {"likelihood, 2 frames": 2, "likelihood, 8 frames": 8}
)
"""Names of the maximum-likelihood motions, and their numbers of frames"""

ROTATION, HEADING = "rotation_error_deg", "heading_error_deg"
YAW, YAW_OF_LIGHT, TRUE_YAW = "yaw_error_deg_s", "yaw_error_of_light_deg_s", "true_yaw_deg_s"

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
    """A photon draw of a sequence, or the light itself."""

    pooling: Pooling
    flux: float
    """Photons per frame, before pooling of frames"""
    repeat: int | None
    """None: light without noise"""


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
        return [self.velocities(self.methods[name], drawn) for drawn in draws]

    def velocities(self, method: Detector, drawn: Drawn) -> Floats:
        """Velocities (pairs, rows, columns, 2) of all blocks, px of the full image per frame.

        For a method without velocities, its responses (T, H, W).
        """

        def measured() -> Floats:
            means = self.means(drawn.pooling, drawn.flux)
            found = method.respond(self._frames_of(drawn), 1 / means.mean())
            px = drawn.pooling.pixels / drawn.pooling.frames
            return found * (px if method.gives == "velocity" else 1.0)

        return self._kept(drawn, benchmarked.identity(method), measured)

    def likely_motions(self, drawn: Drawn, name: str, pairs: Sequence[int]) -> Floats:
        """Most likely rotations (°) and headings of the camera around each pair, (pairs, 6)."""
        frames = LIKELIHOODS[name]

        def measured() -> Floats:
            counts, motions = self._frames_of(drawn), []
            for pair in pairs:
                start = pair - (frames // 2 - 1)
                window = counts[max(start, 0) : start + frames]
                motion: Sequence[float] = (np.nan,) * 6
                if len(window) == frames and camera_motion.tell_motion(window):
                    likely = camera_motion.likely_camera_motion(window, self.camera)
                    motion = (*likely.rotation_deg, *likely.heading)
                motions.append(motion)
            return np.array(motions)

        return self._kept(drawn, f"{name}: {self.camera!r} {list(pairs)}", measured)

    def means(self, pooling: Pooling, flux: float) -> Floats:
        """Mean photons on each pixel of pooled frames (T, H, W)."""
        if pooling not in self._pooled:
            light = pooling.light(self.light)
            self._pooled = {pooling: light / light.sum(axis=(1, 2)).mean()}
        return self._pooled[pooling] * (flux * pooling.frames)

    def _frames_of(self, drawn: Drawn) -> NDArray[Any]:
        """Counts (T, H, W) of a draw, or their means."""
        means = self.means(drawn.pooling, drawn.flux)
        if drawn.repeat is None:
            return means
        return draw_counts(means, self.settings.seed, self.dataset.sequence, *map(str, drawn))

    def _kept(self, drawn: Drawn, name: str, measure: Callable[[], Floats]) -> Floats:
        """Return a measurement of a draw, kept or new."""
        store = ArrayStore(self._folder, digest(self._key, name, repr(drawn)), _NO_LIMIT)
        if (kept := store.read(["found"])) is None:
            store.write(kept := {"found": measure().astype(np.float32)})
        return kept["found"].astype(np.float64)


def perfect_light(dataset: Dataset) -> Floats:
    """Return photons per second on each perfect pixel (T, H, W)."""
    bands = dataset.configuration.render.bands_nm
    parts = [
        photon_rate(radiance, bands, PRESETS["ideal"])
        for _, radiance in read_radiance_frames(dataset)
    ]
    return np.concatenate(parts).astype(np.float64)


def sequence_rows(
    sequence: RankedSequence, segments: int, advance: Callable[[int], object]
) -> Rows:
    """Yield the samples of all metrics; `advance` is called as often as `work` says."""
    yield from endpoint_errors(sequence, segments, advance)
    yield from camera_errors(sequence, advance)
    yield from yaw_errors(sequence, advance)


def work(settings: RankingSettings, methods: benchmarked.Methods) -> int:
    """Return the number of calls of `advance` for one sequence."""
    wide = benchmarked.directional_methods(methods, settings.wide_field)
    cases = len(settings.poolings) * len(methods) + len(wide) + (settings.camera_pairs > 0)
    return cases * len(settings.fluxes)


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
        yield from _in_segments(ranking.MEAN, group, totals, blocks, segments)
        if group == "all":
            far = np.sum([((error > FAR_PX) & among).sum(axis=(1, 2)) for error in errors], axis=0)
            yield from _in_segments(ranking.FAR, group, far.astype(float), blocks, segments)
            medians = [
                np.median([error[pair][there] for error in errors]) if there.any() else 0.0
                for pair, there in enumerate(among)
            ]
            there = (blocks > 0).astype(np.float64)
            yield from _in_segments(ranking.MEDIAN, group, np.array(medians), there, segments)


def _in_segments(metric: str, group: str, totals: Floats, blocks: Floats, segments: int) -> Rows:
    """Yield the sums over the successive pairs of each segment."""
    parts = zip(np.array_split(totals, segments), np.array_split(blocks, segments), strict=True)
    for segment, (total, count) in enumerate(parts):
        yield metric, group, segment, total.sum(), count.sum()


def camera_errors(sequence: RankedSequence, advance: Callable[[int], object]) -> Rows:
    """Yield errors of the camera's rotation and heading, from flow and by maximum likelihood."""
    settings, frames = sequence.settings, sequence.trajectory.frames
    if not settings.camera_pairs:
        return
    # all pairs have the frames around them that the likelihood uses, if the sequence is long enough
    most = max(LIKELIHOODS.values())
    before = most // 2 - 1 if frames >= most else 0
    spread = np.linspace(before, frames - 2 - before, settings.camera_pairs)
    pairs = np.unique(spread.astype(int)).tolist()
    for flux in settings.fluxes:
        motions: dict[str, Any] = {}
        for name in sequence.methods if settings.finest == NO_POOLING else ():
            flow, grid = sequence.noisy(name, NO_POOLING, flux)[0], sequence.grid(name, 1)
            motions[name] = [_fitted(sequence, grid, flow[pair]) for pair in pairs]
        for name in LIKELIHOODS:
            motions[name] = sequence.likely_motions(Drawn(NO_POOLING, flux, 0), name, pairs)
        for name, found in motions.items():
            errors = [motion_errors(sequence, *each) for each in zip(found, pairs, strict=True)]
            for metric, values in zip((ROTATION, HEADING), np.transpose(errors), strict=True):
                for value in values:
                    yield _row(metric, name, flux, sequence, float(value))
        advance(1)


def _fitted(sequence: RankedSequence, grid: BlockGrid, velocities: Floats) -> Floats:
    """Return the motion that best fits the flow (rows, columns, 2) of a pair, (6,)."""
    inside, camera = np.s_[1:-1, 1:-1], sequence.camera
    scale = np.array([camera.width / grid.shape[1], camera.height / grid.shape[0]])
    try:
        found = motion_of_flow(camera, grid.centers[inside] * scale, velocities[inside])
    except ValueError:  # too few blocks have a velocity
        return np.full(6, np.nan)
    return np.concatenate((found.rotation_deg, found.heading))


def motion_errors(sequence: RankedSequence, found: Floats, pair: int) -> tuple[float, float]:
    """Return the errors of a motion (6,) between a frame and the next (degrees), NaN if unknown.

    They are the angle of the remaining rotation, and the angle between the headings.
    """
    if np.isnan(found).any():
        return math.nan, math.nan
    poses = sequence.trajectory.poses()[pair : pair + 2]
    turn = poses[0, :3, :3].T @ poses[1, :3, :3]
    way = poses[0, :3, :3].T @ (poses[1, :3, 3] - poses[0, :3, 3])
    left = Rotation.from_rotvec(found[:3], degrees=True).inv() * Rotation.from_matrix(turn)
    moves = np.linalg.norm(way) >= _STILL_M
    heading = float(endpoint_error.angles_deg(found[3:], way)) if moves else math.nan
    return float(np.degrees(left.magnitude())), heading


def yaw_errors(sequence: RankedSequence, advance: Callable[[int], object]) -> Rows:
    """Learn the yaw rate from noise-free responses to half of a sequence; test on the rest."""
    rates = wide_field.yaw_rates_deg_s(sequence.trajectory)
    wide = benchmarked.directional_methods(sequence.methods, sequence.settings.wide_field)
    for (name, detector), flux in product(wide.items(), sequence.settings.fluxes):
        warm_up = default_warm_up(len(rates) + 1, [detector])
        test = wide_field.YawRateTest(detector, rates, warm_up)
        draws = (Drawn(NO_POOLING, flux, repeat) for repeat in (None, 0))
        test.add(*(sequence.velocities(detector, drawn) for drawn in draws))
        if found := test.result():
            yield _row(TRUE_YAW, name, flux, sequence, found.true_deg_s)
            yield _row(YAW_OF_LIGHT, name, flux, sequence, found.ideal_deg_s)
            yield _row(YAW, name, flux, sequence, found.counts_deg_s)
        advance(1)


def _row(metric: str, name: str, flux: float, sequence: RankedSequence, value: float) -> Any:
    return metric, name, flux, "all", *NO_POOLING, sequence.dataset.sequence, value, 1.0
