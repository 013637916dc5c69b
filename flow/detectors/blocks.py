"""Square blocks of block methods, which give one velocity each, and their common parts.

The dissertation cuts an N × N frame into 10 × 10 blocks. Blocks at the border see less of the
motion (the match may have left the frame), so errors are scored on inner blocks.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, SerializeAsAny
from scipy.ndimage import distance_transform_edt, map_coordinates

from megalopta.core.arrays import Floats, Ints
from megalopta.flow.detectors.base import Detector, Frames, Responder, stacked

BLOCKS_PER_SIDE = 10
_SMALLEST_BLOCK_PX = 2
FEWEST_BLOCKS = 3
"""Fewest blocks along a side: with fewer there is no inner block to score."""


@dataclass(frozen=True)
class BlockGrid:
    """Blocks of a frame of shape (H, W)."""

    shape: tuple[int, int]
    block_px: int

    @property
    def rows(self) -> int:
        """Number of rows of blocks."""
        return self.shape[0] // self.block_px

    @property
    def columns(self) -> int:
        """Number of columns of blocks."""
        return self.shape[1] // self.block_px

    @property
    def top(self) -> int:
        """First pixel row of the first block."""
        return self.shape[0] % self.block_px // 2

    @property
    def left(self) -> int:
        """First pixel column of the first block."""
        return self.shape[1] % self.block_px // 2

    @property
    def corners(self) -> Ints:
        """First pixel row and column of each block, (blocks, 2), row by row."""
        places = np.mgrid[: self.rows, : self.columns].reshape(2, -1).T
        return np.asarray(np.array([self.top, self.left]) + self.block_px * places)

    @property
    def centers(self) -> Floats:
        """Image coordinates (rows, columns, 2), x and y, of the block centers."""
        first = self.corners.reshape(self.rows, self.columns, 2)[..., ::-1]
        return np.ascontiguousarray(first, np.float64) + self.block_px / 2


def block_grid(
    shape: tuple[int, int], block_px: int | None = None, fewest_blocks: int = FEWEST_BLOCKS
) -> BlockGrid:
    """Return the blocks of a frame (H, W); by default a tenth of the shorter side wide.

    Raises ValueError if there are fewer blocks along a side than `fewest_blocks`, or a block is
    smaller than 2 px.
    """
    size = min(shape) // BLOCKS_PER_SIDE if block_px is None else block_px
    if size < _SMALLEST_BLOCK_PX or min(shape) // size < fewest_blocks:
        px = max(size, _SMALLEST_BLOCK_PX)
        least = BLOCKS_PER_SIDE * px if block_px is None else fewest_blocks * px
        raise ValueError(
            f"frames of {shape[0]} × {shape[1]} px cannot be cut into at least {fewest_blocks} ×"
            f" {fewest_blocks} blocks of {px} px: give frames of {least} px or more on a side, a"
            " method without blocks, such as DIS, or in Python another block_px (2 px or more)"
        )
    return BlockGrid(shape=shape, block_px=size)


def block_sums(image: NDArray[Any], grid: BlockGrid) -> NDArray[Any]:
    """Return the sum of an image (H, W) over each block, (rows, columns)."""
    size, rows, columns = grid.block_px, grid.rows, grid.columns
    covered = image[grid.top : grid.top + rows * size, grid.left : grid.left + columns * size]
    strips = covered.reshape(rows, size, columns * size).sum(axis=1)
    return np.asarray(strips.reshape(rows, columns, size).sum(axis=2))


def mean_over_blocks(flow: Floats, grid: BlockGrid) -> Floats:
    """Return the mean of a dense flow (H, W, 2) over each block, (rows, columns, 2)."""
    sums = [block_sums(flow[..., axis], grid) for axis in range(2)]
    return np.stack(sums, axis=-1) / grid.block_px**2


def between_blocks(velocities: Floats, grid: BlockGrid) -> Floats:
    """Return velocities of blocks (rows, columns, 2) at every pixel, (H, W, 2).

    Linear between block centers, constant beyond the outermost. Blocks without velocity are
    ignored, and the flow is undefined (NaN) at their pixels.
    """
    missing: Any = ~np.isfinite(velocities).all(axis=-1)
    if missing.all():
        return np.full((*grid.shape, 2), np.nan)
    _, nearest = distance_transform_edt(missing, return_indices=True)
    known = velocities[tuple(nearest)]
    along = (
        (np.arange(side) + 0.5 - first) / grid.block_px - 0.5
        for side, first in zip(grid.shape, (grid.top, grid.left), strict=True)
    )
    places = np.stack(np.meshgrid(*along, indexing="ij"))
    between = partial(map_coordinates, coordinates=places, mode="nearest")
    flow = [between(known[..., axis], order=1) for axis in range(2)]
    is_missing = between(missing.astype(np.uint8), order=0)[..., np.newaxis]
    return np.where(is_missing, np.nan, np.stack(flow, axis=-1))


class BlockDetector(Detector, frozen=True):
    """A detector that compares neighboring frames block by block."""

    gives: ClassVar[Literal["response", "velocity"]] = "velocity"
    minimum_frames: ClassVar[int] = 2

    block_px: Annotated[int, Field(ge=2)] | None = None
    """Side of a block (px); default: a tenth of the shorter side of the frame"""
    fewest_blocks: Annotated[int, Field(ge=1)] = FEWEST_BLOCKS
    """Smaller frames are refused; 1 allows a single block with its margin"""
    noise: tuple[Annotated[float, Field(gt=0)], Annotated[float, Field(ge=0)]] = (1.0, 0.0)
    """a and b of the variance a·mean + b of pixels (`reading_noise` of a sensor); by default that
    of counts"""

    @property
    def memory_frames(self) -> int:
        """1: a pair of frames."""
        return 1

    def scored(self, responses: Floats) -> Floats:
        """Return the velocities of the blocks inside."""
        return responses[:, 1:-1, 1:-1, :]

    def grid(self, shape: tuple[int, int]) -> BlockGrid:
        """Return the blocks of a frame (H, W).

        Raises ValueError if the frame is too small.
        """
        try:
            return block_grid(shape, self.block_px, self.fewest_blocks)
        except ValueError as problem:
            raise ValueError(f"{self.name}: {problem}") from None

    @property
    def most_frames(self) -> float:
        """Most frames that `dense` uses together."""
        return self.memory_frames + 1

    def dense(self, *frames: Frames) -> Floats:
        """Return the flow (H, W, 2) of frames (H, W) of one steady motion, px per frame, x then y.

        Two successive frames, or as many more as the method uses together. Velocities of blocks are
        interpolated linearly between block centers, and constant beyond the outermost; NaN at the
        pixels of blocks without velocity. Raises ValueError if frames are too many or too small,
        differ in shape, or are not light, or counts if the method needs them.
        """
        sequence = self.checked(frames)
        grid = self.grid((sequence.shape[1], sequence.shape[2]))
        return between_blocks(self.respond(sequence)[-1], grid)

    def checked(self, frames: Sequence[Frames]) -> Frames:
        """Return frames (H, W) of one motion as one array (T, H, W); raises as `dense`."""
        sequence = stacked(frames)
        if not self.minimum_frames <= len(frames) <= self.most_frames:
            raise ValueError(
                f"{len(frames)} frames: {self.name} takes {self.minimum_frames}"
                + (f" to {self.most_frames}" if self.most_frames > self.minimum_frames else "")
            )
        if self.takes_counts and not self.noise[1] and sequence.min() < 0:
            raise ValueError(
                f"frames hold negative pixels: {self.name} takes counts, 0 or more, or readings"
                " with the sensor's noise"
            )
        return sequence

    def as_counts(self, frames: Frames) -> Frames:
        """Return frames of any shape whose variance is their mean, as that of counts: y/a + b/a².

        Their roots have the same noise in dim and bright light (the generalized transform of
        Murtagh, Starck and Bijaoui, Astron. Astrophys. Suppl. 112, 179, 1995, without its 3/8).
        """
        is_of_counts = self.noise == (1.0, 0.0)
        return frames if is_of_counts else frames / self.noise[0] + self.dark_counts

    @property
    def dark_counts(self) -> float:
        """The part of `as_counts` that stands for noise without light."""
        return self.noise[1] / self.noise[0] ** 2

    def start(self, shape: tuple[int, int]) -> Responder:
        """Return the detector of the newest of frames (H, W); see `Detector.start`."""
        grid = self.grid(shape)
        window: list[Any] = []

        def respond(frames: Frames, _: float) -> Floats:
            velocities = []
            for frame in frames:
                window.append(self.prepared(grid, frame))
                del window[: -1 - self.memory_frames]
                if len(window) > 1:
                    velocities.append(self.velocities(grid, window))
            return np.array(velocities).reshape(-1, grid.rows, grid.columns, 2)

        return respond

    def prepared(self, grid: BlockGrid, frame: Frames) -> Any:
        """Return a frame (H, W) as needed by `velocities`; a copy, as the caller's may change."""
        return self.as_counts(frame).copy()

    def velocities(self, grid: BlockGrid, window: list[Any]) -> Floats:
        """Return the velocities of the blocks, (rows × columns, 2) in any shape.

        From two to `memory_frames` + 1 prepared frames, the newest last.
        """
        raise NotImplementedError


class PooledFrames(BlockDetector, frozen=True):
    """A block detector that pools the newest frames."""

    frames: Annotated[int, Field(ge=3, le=32)] = 8
    """Frames of one velocity, the newest included"""

    @property
    def memory_frames(self) -> int:
        """The frames that are pooled with the newest."""
        return self.frames - 1


def thesis_radius_px(shape: tuple[int, int]) -> int:
    """Return the search radius, which grows with the shorter side N of the frame.

    (75 + N)/45, rounded: the dissertation's 3, 4, 6 and 7 px at N = 60, 120, 180 and 240.
    """
    return round((75 + min(shape)) / 45)


class SummedFrames(PooledFrames, frozen=True):
    """The velocity of a method between sums of successive frames."""

    method: SerializeAsAny[BlockDetector]
    """Method for two frames"""
    frames: Annotated[int, Field(ge=4, le=64, multiple_of=2)] = 8
    """Frames of both sums; fewer at the start of a sequence"""

    def grid(self, shape: tuple[int, int]) -> BlockGrid:
        """Return the blocks of the method in a frame (H, W)."""
        return self._inner.grid(shape)

    @property
    def _inner(self) -> BlockDetector:
        changes = {"block_px": self.block_px, "fewest_blocks": self.fewest_blocks}
        return self.method.model_copy(update=changes | {"noise": (1.0, 0.0)})  # of `prepared`

    def velocities(self, grid: BlockGrid, window: list[Frames]) -> Floats:
        """Return the velocities between both sums."""
        half = len(window) // 2
        halves = np.reshape(window[-2 * half :], (2, half, *grid.shape))
        sums = halves.sum(axis=1, dtype=np.float64)
        return np.asarray(self._inner.respond(sums)[-1] / half)

    def scored(self, responses: Floats) -> Floats:
        """Return the scored values of the method itself."""
        return self.method.scored(responses)


def summed_frames(method: BlockDetector, frames: int = 8) -> SummedFrames:
    """Return a method between the sums of the first and the second half of `frames` frames."""
    half = frames // 2
    return SummedFrames(
        name=f"{method.name} {half}+{half}",
        label=f"{method.label}, sums of {half} frames",
        method=method,
        frames=frames,
        block_px=method.block_px,
        fewest_blocks=method.fewest_blocks,
        noise=method.noise,
    )
