"""Metrics on one rendered sequence: each is a function that yields its cases.

A block's error is its endpoint error in px of the full image per frame; a block without velocity
counts as zero motion. Means are over all blocks of a group. Groups show where a ranking changes:
blocks hidden in the next frame, depth edges, image speed, distance, and parallax, the motion that
remains without the camera's rotation.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import product
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from megalopta.benchmark.methods import Methods, directional_methods
from megalopta.benchmark.ranking_settings import NO_POOLING, Pooling, RankingSettings
from megalopta.benchmark.table import Case, Sums
from megalopta.benchmark.velocities import LIKELIHOODS, Drawn, Velocities
from megalopta.core.arrays import Floats
from megalopta.dataset.frames import read_truth_frames
from megalopta.dataset.store import Dataset
from megalopta.flow.benchmark.settings import default_warm_up
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.egomotion.motion_of_flow import motion_of_flow
from megalopta.flow.egomotion.wide_field import YawRateTest, yaw_rates_deg_s
from megalopta.flow.metrics.endpoint_error import (
    OCCLUDED_SHARE,
    angles_deg,
    block_flow,
    block_share,
)
from megalopta.scenes.cameras.base import Camera

if TYPE_CHECKING:
    from megalopta.render import Truth

SPEEDS_PX = (1.0, 3.0)
PARALLAX_PX = (0.3, 1.0)
DISTANCES_M = (5.0, 20.0)
_EDGE_RATIO = 1.25
_EDGE_SHARE = 0.05

_TURNING_PX = 0.01
"""Largest parallax of a sequence of rotation alone, in which nothing moves"""

Groups: TypeAlias = Mapping[str, NDArray[np.bool_]]
"""Mask of the blocks of each group"""

RANGES = ("low", "medium", "high")
ALONE, LITTLE, MUCH, HIDDEN = "rotation alone", "low parallax", "high parallax", "hidden"
"""Visible blocks of sequences of rotation alone; visible blocks of other sequences with low or high
parallax; hidden blocks of other sequences"""


class Opposed(NamedTuple):
    """Two groups between which the order of methods may change, and the property that differs."""

    one: str
    other: str
    what: str


def opposed(blocks: Mapping[str, int]) -> list[Opposed]:
    """Return the groups to compare, of equal speed if possible.

    Parallax and occlusion are compared with rotation alone if there are such sequences, otherwise
    with low parallax.
    """
    before = ALONE if any(blocks.get(at_speed(each, ALONE)) for each in RANGES) else LITTLE
    found = [
        Opposed(at_speed(speed, before), at_speed(speed, after), what)
        for after, what in ((MUCH, "parallax"), (HIDDEN, "occlusion"))
        for speed in RANGES
    ]
    return [
        *found,
        Opposed("smooth", "depth edge", "depth edges"),
        Opposed("speed low", "speed high", "speed"),
    ]


@dataclass(frozen=True, eq=False)
class BlockTruths:
    """Truth of the inner blocks (pairs, rows, columns) of a sequence at one pooling."""

    velocities: Floats
    """(..., 2) in px of the full image per frame; NaN where unknown"""
    groups: Groups


class SequenceTruth:
    """Truth of a sequence on the finest blocks, read once; `at` pools it over frames."""

    def __init__(self, dataset: Dataset, grid: BlockGrid) -> None:
        self._frames = dataset.configuration.trajectory.frames
        facts = [_facts(truth, turned, grid) for truth, turned in _pairs(dataset)]
        self._facts = {name: np.stack([each[name] for each in facts]) for name in facts[0]}
        parallax = self._facts["parallax"]
        self._only_turns = bool((parallax[np.isfinite(parallax)] < _TURNING_PX).all())

    def at(self, pooling: Pooling) -> BlockTruths:
        """Return the truth between pooled frames."""
        steps = list(pooling.steps(self._frames))
        mean = {
            name: np.stack([values[each].mean(axis=0) for each in steps])[:, 1:-1, 1:-1]
            for name, values in self._facts.items()
        }
        return BlockTruths(mean["velocity"], _groups(mean, self._only_turns))


def _pairs(dataset: Dataset) -> "Iterator[tuple[Truth, Floats]]":
    """Yield the truth of each frame but the last, and the flow by rotation alone."""
    camera, poses = dataset.configuration.camera, dataset.configuration.trajectory.poses()
    directions = camera.directions()
    for index, truth in enumerate(read_truth_frames(dataset)):
        if index + 1 < len(poses):
            turn = poses[index + 1, :3, :3].T @ poses[index, :3, :3]
            yield truth, camera.displacement(directions @ turn.T)


def _facts(truth: "Truth", turned: Floats, grid: BlockGrid) -> dict[str, Floats]:
    """Means over the blocks (rows, columns) of one pair of frames."""
    flow, hidden = truth.flow_forward[np.newaxis], truth.occluded_forward[np.newaxis]
    to_full = np.array(truth.depth.shape[::-1]) / np.array(grid.shape[::-1])
    velocity = block_flow(flow, grid, hidden)[0] * to_full
    rotation = block_flow(turned[np.newaxis], grid, hidden)[0] * to_full
    return {
        "velocity": velocity,
        "parallax": np.linalg.norm(velocity - rotation, axis=-1),
        "hidden": block_share(hidden, grid)[0],
        "edges": block_share(_edges(truth.depth)[np.newaxis], grid)[0],
        "distance": _typical(truth.depth, grid),
    }


def _edges(depth: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Pixels with a right or lower neighbor that is a quarter farther or nearer."""
    log = np.log(np.where(np.isfinite(depth), depth, 1e6))
    edges = np.zeros(depth.shape, np.bool_)
    edges[:, :-1] |= np.abs(np.diff(log, axis=1)) > np.log(_EDGE_RATIO)
    edges[:-1] |= np.abs(np.diff(log, axis=0)) > np.log(_EDGE_RATIO)
    return edges


def _typical(depth: NDArray[np.float32], grid: BlockGrid) -> Floats:
    """Distance of each block, m: the inverse of its mean inverse depth."""
    inverse = np.where(depth > 0, 1 / depth.astype(np.float64), 0)
    mean = block_flow(np.dstack([inverse, inverse])[np.newaxis], grid)[0, ..., 0]
    mean *= depth.shape[1] / grid.shape[1]  # unlike a flow
    with np.errstate(divide="ignore"):
        return np.asarray(1 / mean)


def _groups(facts: Mapping[str, Floats], only_turns: bool) -> dict[str, NDArray[np.bool_]]:
    speed = np.linalg.norm(facts["velocity"], axis=-1)
    known = np.isfinite(speed)
    groups = {
        "all": known,
        "visible": facts["hidden"] < OCCLUDED_SHARE,
        "occluded": facts["hidden"] >= OCCLUDED_SHARE,
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
        for at, name in enumerate(RANGES):
            groups[f"{kind} {name}"] = place == at
    seen, hidden = groups["visible"], groups["occluded"]
    for name in RANGES:
        here = groups[f"speed {name}"]
        groups |= {cell_name(name, each): here & groups[f"parallax {each}"] for each in RANGES}
        groups |= {
            at_speed(name, ALONE): here & seen & only_turns,
            at_speed(name, LITTLE): here & seen & groups["parallax low"] & (not only_turns),
            at_speed(name, MUCH): here & seen & groups["parallax high"],
            at_speed(name, HIDDEN): here & hidden & (not only_turns),
        }
    return {name: among & known for name, among in groups.items()}


def cell_name(speed: str, parallax: str) -> str:
    """Name of the group of one cell of the atlas."""
    return f"speed {speed}, parallax {parallax}"


def at_speed(speed: str, kind: str) -> str:
    """Name of the group of blocks of one kind at low, medium or high speed."""
    return f"{kind}, speed {speed}"


ERROR = "epe_px"
TEXTURE = "texture_px"
ROTATION, HEADING = "rotation_error_deg", "heading_error_deg"
YAW, YAW_OF_LIGHT, TRUE_YAW = "yaw_error_deg_s", "yaw_error_of_light_deg_s", "true_yaw_deg_s"

STILL = "zero motion"
"""Baseline that a method must beat: no motion anywhere"""

BOUND = "Poisson bound"

_STILL_M = 1e-9

Measured: TypeAlias = Iterator[tuple[Case, Sums]]
"""Sums over the pairs of frames of a sequence, or one number for it, by case"""


@dataclass(frozen=True)
class Example:
    """Velocities (rows, columns, 2) of one pair of frames at the finest pooling."""

    truth: Floats
    found: Mapping[str, Mapping[float, Floats]]
    """By method and photons per frame"""


class RankedSequence:
    """A sequence, the methods on it, and its ground truth."""

    def __init__(
        self, dataset: Dataset, settings: RankingSettings, methods: Methods, velocities: Velocities
    ) -> None:
        self.dataset, self.settings, self.methods = dataset, settings, methods
        self.velocities = velocities
        traced = cache(partial(SequenceTruth, dataset))
        self.truth = cache(lambda grid, pooling: traced(grid).at(pooling))
        """The `BlockTruths` of the blocks of a grid between pooled frames"""

    def grid(self, name: str, pixels: int) -> BlockGrid:
        """Return the blocks of a method on pooled frames; ValueError if these are too small."""
        camera = self.dataset.configuration.camera
        return self.methods[name].grid(Pooling(pixels, 1).shape((camera.height, camera.width)))

    def noisy(self, name: str, pooling: Pooling, flux: float) -> list[Floats]:
        """Return the velocities by a method in each photon draw."""
        repeats = range(self.settings.repeats)
        found = (Drawn(pooling, flux, repeat) for repeat in repeats)
        return [self.velocities.of(self.methods[name], drawn) for drawn in found]


def endpoint_errors(sequence: RankedSequence) -> Measured:
    """Yield errors of every method and of zero motion, by group, and the Poisson bound."""
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


def texture_scales(sequence: RankedSequence) -> Measured:
    """Yield the median texture scale of each group's blocks, in each pair of frames, px."""
    for pooling in sequence.settings.poolings:
        grid = sequence.grid(next(iter(sequence.methods)), pooling.pixels)
        texture = sequence.velocities.texture_px(grid, pooling)
        for group, among in sequence.truth(grid, pooling).groups.items():
            pairs = zip(texture, among, strict=True)
            each = [float(np.median(scale[here])) for scale, here in pairs if here.any()]
            for flux in sequence.settings.fluxes if each else ():
                yield Case(TEXTURE, "light", flux, group, *pooling), _values(each)


def camera_errors(sequence: RankedSequence) -> Measured:
    """Yield errors of the camera's rotation and heading, from flow and by maximum likelihood."""
    settings = sequence.settings
    frames = sequence.dataset.configuration.trajectory.frames
    pairs = _chosen_pairs(frames, settings.camera_pairs).tolist()
    for flux in settings.fluxes if pairs else ():
        for name, motions in _camera_motions(sequence, flux, pairs):
            found = zip(motions, pairs, strict=True)
            errors = [_motion_errors(sequence.dataset, *each) for each in found]
            for metric, values in zip((ROTATION, HEADING), np.transpose(errors), strict=True):
                yield Case(metric, name, flux), _values(values)


def _camera_motions(
    sequence: RankedSequence, flux: float, pairs: Sequence[int]
) -> Iterator[tuple[str, Sequence[Floats]]]:
    """Yield each estimator's rotations (°) and headings of pairs, (6,) each; NaN if it has none."""
    for name in sequence.methods if sequence.settings.finest == NO_POOLING else ():
        flow, grid = sequence.noisy(name, NO_POOLING, flux)[0], sequence.grid(name, 1)
        yield name, [_fitted(sequence.dataset.configuration.camera, grid, flow[at]) for at in pairs]
    for name in LIKELIHOODS:
        drawn = Drawn(NO_POOLING, flux, 0)
        yield name, list(sequence.velocities.likely_motions(drawn, name, pairs))


def yaw_errors(sequence: RankedSequence) -> Measured:
    """Learn the yaw rate from noise-free responses to half of a sequence; test on the rest."""
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


METRICS = (endpoint_errors, texture_scales, camera_errors, yaw_errors)
"""All metrics: `ERROR` is averaged over blocks, of others the median counts"""


def example_of(sequence: RankedSequence) -> Example:
    """Return true and estimated velocities of the pair in the middle."""
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
    """Return the endpoint errors (pairs, rows, columns) of the inner blocks."""
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
    """Return `count` pairs, by their first frames, spread over a sequence.

    All have the frames around them that the likelihood uses, if the sequence is long enough.
    """
    most = max(LIKELIHOODS.values())
    before = most // 2 - 1 if frames >= most else 0
    return np.unique(np.linspace(before, frames - 2 - before, count).astype(int))


def _fitted(camera: Camera, grid: BlockGrid, velocities: Floats) -> Floats:
    """Return the motion that best fits the flow (rows, columns, 2) of a pair, (6,)."""
    inside = np.s_[1:-1, 1:-1]
    scale = np.array([camera.width / grid.shape[1], camera.height / grid.shape[0]])
    try:
        found = motion_of_flow(camera, grid.centers[inside] * scale, velocities[inside])
    except ValueError:  # too few blocks have a velocity
        return np.full(6, np.nan)
    return np.concatenate((found.rotation_deg, found.heading))


def _motion_errors(dataset: Dataset, found: Floats, pair: int) -> tuple[float, float]:
    """Return the errors of a motion (6,) between a frame and the next (degrees), NaN if unknown.

    They are the angle of the remaining rotation, and the angle between the headings.
    """
    if np.isnan(found).any():
        return math.nan, math.nan
    poses = dataset.configuration.trajectory.poses()[pair : pair + 2]
    turn = poses[0, :3, :3].T @ poses[1, :3, :3]
    way = poses[0, :3, :3].T @ (poses[1, :3, 3] - poses[0, :3, 3])
    left = Rotation.from_rotvec(found[:3], degrees=True).inv() * Rotation.from_matrix(turn)
    moves = np.linalg.norm(way) >= _STILL_M
    heading = float(angles_deg(found[3:], way)) if moves else math.nan
    return float(np.degrees(left.magnitude())), heading


def _values(values: Sequence[float] | Floats) -> Sums:
    return Sums(np.array(values), np.ones(len(values)))
