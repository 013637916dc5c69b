"""What detectors that give one velocity per block have in common."""

from collections.abc import Callable
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from megalopta.flow.detectors.base import Detector, FloatArray, Frames, Responder
from megalopta.flow.detectors.blocks import FEWEST_BLOCKS, BlockGrid, block_grid


class BlockDetector(Detector, frozen=True):
    """A detector that compares neighboring frames block by block."""

    gives: ClassVar[Literal["response", "velocity"]] = "velocity"
    tells_direction: ClassVar[bool] = True
    minimum_frames: ClassVar[int] = 2

    block_px: Annotated[int, Field(ge=2)] | None = None
    """Side of a block (px); by default a tenth of the shorter side of the frame"""

    fewest_blocks: Annotated[int, Field(ge=1)] = FEWEST_BLOCKS
    """Smaller frames are refused; 1 lets a detector see a single block and the margin around it"""

    @property
    def memory_frames(self) -> int:
        """1: a pair of frames."""
        return 1

    def scored(self, responses: FloatArray) -> FloatArray:
        """Return the velocities of the blocks inside."""
        return responses[:, 1:-1, 1:-1, :]

    def grid(self, shape: tuple[int, int]) -> BlockGrid:
        """Return where the blocks of a frame (H, W) lie.

        Raises
        ------
        ValueError
            When the frame is too small.
        """
        return block_grid(shape, self.block_px, self.fewest_blocks)

    def over_window(
        self,
        grid: BlockGrid,
        velocity: Callable[[list[Any], float], FloatArray],
        prepared: Callable[[Frames], Any] = lambda frame: frame,
    ) -> Responder:
        """Return a responder that asks for the velocities of the newest frames, one by one.

        Parameters
        ----------
        grid
        velocity
            Of the blocks, (rows × columns, 2) in any shape, from two to `memory_frames` + 1
            prepared frames, the newest last, and the scale.
        prepared
            What is kept of a frame (H, W).
        """
        window: list[Any] = []

        def respond(frames: Frames, scale: float) -> FloatArray:
            velocities = []
            for frame in frames:
                window.append(prepared(frame))
                del window[: -1 - self.memory_frames]
                if len(window) > 1:
                    velocities.append(velocity(window, scale))
            return np.array(velocities).reshape(-1, grid.rows, grid.columns, 2)

        return respond
