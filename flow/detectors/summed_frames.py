"""A method of two frames, given the sums of several frames before and after.

What a reviewer asks for first: with n frames, the first half is added up, and so is the second; the
motion between the two sums, over n/2 frames, is divided by n/2. Summing keeps all photons and
blurs by the motion over n/2 frames, which is little where that is below the detail that the photons
show at all.
"""

from typing import Annotated

import numpy as np
from pydantic import Field, SerializeAsAny

from megalopta.flow.detectors.base import FloatArray, Responder
from megalopta.flow.detectors.blocks import BlockDetector


class SummedFrames(BlockDetector, frozen=True):
    """The velocity of a method between sums of successive frames."""

    method: SerializeAsAny[BlockDetector]
    """Of two frames"""

    frames: Annotated[int, Field(ge=4, le=64, multiple_of=2)] = 8
    """Frames of both sums; at the start of a sequence there are fewer"""

    @property
    def memory_frames(self) -> int:
        """All frames but the newest."""
        return self.frames - 1

    def start(self, shape: tuple[int, int]) -> Responder:
        """Return the method for frames (H, W); see `Detector.start`."""
        changes = {"block_px": self.block_px, "fewest_blocks": self.fewest_blocks}
        inner = self.method.model_copy(update=changes)

        def velocity(window: list[FloatArray], scale: float) -> FloatArray:
            half = len(window) // 2
            sums = np.stack([sum(window[-2 * half : -half]), sum(window[-half:])])
            return np.asarray(inner.respond(sums, scale)[-1] / half)

        return self.over_window(inner.grid(shape), velocity, lambda frame: frame.astype(np.float64))

    def scored(self, responses: FloatArray) -> FloatArray:
        """Return what the method itself is scored by."""
        return self.method.scored(responses)


def summed_frames(method: BlockDetector, frames: int = 8) -> SummedFrames:
    """Return a method between the sums of the first and of the second half of some frames."""
    half = frames // 2
    return SummedFrames(
        name=f"{method.name} {half}+{half}",
        label=f"{method.label}, sums of {half} frames",
        method=method,
        frames=frames,
    )
