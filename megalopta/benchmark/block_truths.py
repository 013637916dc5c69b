"""True motion of the blocks of a rendered sequence, and groups of blocks.

Groups show where a ranking changes: blocks hidden in the next frame, depth edges, image speed,
distance, and parallax, the motion that remains without the camera's rotation.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from megalopta.benchmark.ranking_settings import Pooling
from megalopta.core.arrays import Floats
from megalopta.dataset.frames import read_truth_frames
from megalopta.dataset.store import Dataset
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.metrics.endpoint_error import OCCLUDED_SHARE, block_flow, block_share

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
