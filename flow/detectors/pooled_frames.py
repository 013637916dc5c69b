"""What detectors that pool several frames of one velocity have in common."""

from typing import Annotated

from pydantic import Field

from megalopta.flow.detectors.block_detector import BlockDetector


class PooledFrames(BlockDetector, frozen=True):
    """A block detector that takes the newest frames together."""

    frames: Annotated[int, Field(ge=3, le=32)] = 8
    """Frames that are taken to have one velocity, the newest included"""

    @property
    def memory_frames(self) -> int:
        """The frames that are pooled with the newest."""
        return self.frames - 1
