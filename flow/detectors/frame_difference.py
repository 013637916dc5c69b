"""Frame difference (FD): how much each pixel changed since the frame before, blind to direction."""

from typing import ClassVar, Literal

import numpy as np

from megalopta.flow.detectors.base import Detector, FloatArray, Frames, Responder


class FrameDifference(Detector, frozen=True):
    """Size of the change of each pixel since the frame before."""

    gives: ClassVar[Literal["response", "velocity"]] = "response"

    name: str = "FD"
    """Short name"""

    label: str = "Frame difference"
    """Name in words"""

    @property
    def memory_frames(self) -> int:
        """1: the frame before."""
        return 1

    def start(self, shape: tuple[int, int]) -> Responder:
        """Return the differences of frames (H, W); see `Detector.start`."""
        last: FloatArray | None = None

        def respond(frames: Frames, scale: float) -> FloatArray:
            nonlocal last
            scaled = frames * np.float64(scale)
            joined = np.concatenate((scaled[:1] if last is None else last, scaled))
            last = scaled[-1:]
            return np.asarray(np.abs(np.diff(joined, axis=0)))

        return respond

    def scored(self, responses: FloatArray) -> FloatArray:
        """Return all pixels but those at the border."""
        return responses[:, 1:-1, 1:-1, np.newaxis]
