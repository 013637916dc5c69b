"""Errors of methods on one rendered sequence: rows of the long table, by group of blocks.

Photons are drawn on perfect pixels from the rendered light, with one scale for all frames; all
methods see the same draws. A block's error is its endpoint error in px per frame; a block without
velocity counts as zero motion.

Groups show where a ranking changes: blocks hidden in the next frame, depth edges, image speed,
distance, and parallax, the motion that remains without the camera's rotation.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from megalopta.benchmark import methods as benchmarked, table
from megalopta.core.array_store import ArrayStore
from megalopta.core.arrays import Floats, Mask
from megalopta.core.freshness import code_digest, digest
from megalopta.dataset.frames import read_radiance_frames, read_truth_frames
from megalopta.dataset.store import Dataset
from megalopta.flow.detectors.blocks import BlockDetector, BlockGrid
from megalopta.flow.metrics import endpoint_error, translation_bound
from megalopta.flow.stimuli.photons import draw_counts
from megalopta.sensor import PRESETS, photon_rate

STILL = "zero motion"
"""Baseline that a method must beat: no motion anywhere"""
BOUND = "Poisson bound"
RANGES = ("low", "medium", "high")
SPEEDS_PX = (1.0, 3.0)
PARALLAX_PX = (0.3, 1.0)
DISTANCES_M = (5.0, 20.0)
"""Limits between low, medium and high"""
_EDGE_RATIO = 1.25
_EDGE_SHARE = 0.05
_STREAM = "1 × 1 px, 1 frame"
"""Name of the photon draws on single pixels and frames, a part of their seed"""

Rows: TypeAlias = Iterator[tuple[Any, ...]]
"""Rows of `table.samples`"""


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
    for index, truth in enumerate(read_truth_frames(dataset)):
        if index + 1 < len(poses):
            turn = poses[index + 1, :3, :3].T @ poses[index, :3, :3]
            pairs.append(_block_means(truth, camera.displacement(directions @ turn.T), grid))
    means = {name: np.stack([pair[name] for pair in pairs])[:, 1:-1, 1:-1] for name in pairs[0]}
    speed = np.linalg.norm(means["velocity"], axis=-1)
    groups = {
        "all": np.isfinite(speed),
        "visible": means["hidden"] < endpoint_error.OCCLUDED_SHARE,
        "occluded": means["hidden"] >= endpoint_error.OCCLUDED_SHARE,
        "smooth": means["edges"] < _EDGE_SHARE,
        "depth edge": means["edges"] >= _EDGE_SHARE,
    }
    kinds = (
        ("speed", speed, SPEEDS_PX),
        ("parallax", means["parallax"], PARALLAX_PX),
        ("distance", means["distance"], DISTANCES_M),
    )
    for kind, values, bounds in kinds:
        place = np.digitize(values, bounds)
        groups |= {f"{kind} {name}": place == at for at, name in enumerate(RANGES)}
    for name in RANGES:
        for parallax in RANGES:
            cell = groups[f"speed {name}"] & groups[f"parallax {parallax}"]
            groups[cell_name(name, parallax)] = cell
    return BlockTruth(
        means["velocity"], {name: blocks & groups["all"] for name, blocks in groups.items()}
    )


def _block_means(truth: Any, turned: Floats, grid: BlockGrid) -> dict[str, Floats]:
    """Means over the blocks (rows, columns) of one pair of frames.

    `truth` is a `render.Truth`; `turned` the flow by the camera's rotation alone.
    """
    flow, hidden, depth = truth.flow_forward[None], truth.occluded_forward[None], truth.depth
    velocity = endpoint_error.block_flow(flow, grid, hidden)[0]
    rotation = endpoint_error.block_flow(turned[None], grid, hidden)[0]

    # edges: a right or lower neighbor is a quarter farther or nearer
    log = np.log(np.where(np.isfinite(depth), depth, 1e6))
    edges = np.zeros(depth.shape, np.bool_)
    edges[:, :-1] |= np.abs(np.diff(log, axis=1)) > np.log(_EDGE_RATIO)
    edges[:-1] |= np.abs(np.diff(log, axis=0)) > np.log(_EDGE_RATIO)

    # distance: the inverse of the mean inverse depth
    inverse = np.where(depth > 0, 1 / depth.astype(np.float64), 0)
    nearness = endpoint_error.block_flow(np.dstack([inverse, inverse])[None], grid)[0, ..., 0]
    with np.errstate(divide="ignore"):
        distance = np.asarray(1 / nearness)
    return {
        "velocity": velocity,
        "parallax": np.linalg.norm(velocity - rotation, axis=-1),
        "hidden": endpoint_error.block_share(hidden, grid)[0],
        "edges": endpoint_error.block_share(edges[None], grid)[0],
        "distance": distance,
    }


def cell_name(speed: str, parallax: str) -> str:
    """Name of the group of one cell of the atlas."""
    return f"speed {speed}, parallax {parallax}"


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

    def __init__(self, dataset: Dataset, light: Floats, seed: int, folder: Path) -> None:
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
            stream = self._sequence, _STREAM, str(flux), str(repeat)
            counts = draw_counts(means, self._seed, *stream)
            velocities = method.respond(counts, 1 / means.mean())
            store.write(kept := {"velocities": velocities.astype(np.float32)})
        return kept["velocities"].astype(np.float64)


def endpoint_errors(
    dataset: Dataset,
    photons: Photons,
    methods: benchmarked.Methods,
    fluxes: Sequence[float],
    repeats: int,
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

    for flux in fluxes:
        for grid, (name, method) in zip(grids, methods.items(), strict=True):
            truth, errors = truth_of(grid), []
            for repeat in range(repeats):
                velocities = photons.velocities(method, flux, repeat)[:, 1:-1, 1:-1]
                is_known = np.isfinite(velocities).all(axis=-1, keepdims=True)
                difference = np.where(is_known, velocities, 0) - truth.velocities
                errors.append(np.linalg.norm(difference, axis=-1))
            yield from rows(name, flux, errors, truth)
            advance(1)
        truth = truth_of(grids[0])
        speed = np.linalg.norm(truth.velocities, axis=-1)
        least = [
            translation_bound.cramer_rao_covariance(
                translation_bound.fisher_information(frame, grids[0])
            )
            for frame in photons.means(flux)[:-1]
        ]
        trace = np.trace(np.array(least), axis1=-2, axis2=-1)[:, 1:-1, 1:-1]
        yield from rows(STILL, flux, [speed], truth)
        yield from rows(BOUND, flux, [np.minimum(np.sqrt(np.pi / 4 * trace), speed)], truth)


def _by_group(errors: Sequence[Floats], truth: BlockTruth, segments: int) -> Rows:
    """Yield metric, group, segment, total and blocks of errors (pairs, rows, columns) of draws."""
    for group, inside in truth.groups.items():
        totals = np.sum([np.where(inside, error, 0).sum(axis=(1, 2)) for error in errors], axis=0)
        blocks = len(errors) * inside.sum(axis=(1, 2)).astype(np.float64)
        yield from in_segments(table.MEAN, group, totals, blocks, segments)
        if group == "all":
            far = [((error > table.FAR_PX) & inside).sum(axis=(1, 2)) for error in errors]
            totals = np.sum(far, axis=0).astype(float)
            yield from in_segments(table.FAR, group, totals, blocks, segments)
            medians = [
                np.median([error[pair][known] for error in errors]) if known.any() else 0.0
                for pair, known in enumerate(inside)
            ]
            pairs = (blocks > 0).astype(np.float64)
            yield from in_segments(table.MEDIAN, group, np.array(medians), pairs, segments)


def in_segments(metric: str, group: str, totals: Floats, blocks: Floats, segments: int) -> Rows:
    """Yield the sums over the successive pairs of each segment."""
    parts = zip(np.array_split(totals, segments), np.array_split(blocks, segments), strict=True)
    for segment, (total, count) in enumerate(parts):
        yield metric, group, segment, total.sum(), count.sum()
