"""What detectors that give one velocity per block have in common."""

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from megalopta.flow.detectors.base import Detector
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

    def grid(self, shape: tuple[int, int]) -> BlockGrid:
        """Return where the blocks of a frame (H, W) lie.

        Raises
        ------
        ValueError
            When the frame is too small.
        """
        return block_grid(shape, self.block_px, self.fewest_blocks)
