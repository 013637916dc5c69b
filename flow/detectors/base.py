"""Common interface of all motion detectors.

To add a detector: derive from `Detector` in a new file of this folder, with a default for each
parameter, and write a test; `megalopta.flow.detectors.registry` finds it.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from megalopta.core.arrays import Floats

Frames = NDArray[Any]
Responder = Callable[[Frames, float], Floats]
"""Maps the next chunk of frames (n, H, W) and its scale to the responses of that chunk."""


class Detector(BaseModel, ABC, frozen=True, extra="forbid", allow_inf_nan=False):
    """A motion detector with its parameters.

    A "response" detector gives one number per pixel and frame, (T, H, W). A "velocity" detector
    compares neighboring frames and gives one velocity per block and pair of frames,
    (T − 1, rows, columns, 2).
    """

    gives: ClassVar[Literal["response", "velocity"]]
    ignores_offset: ClassVar[bool] = True
    """True if a constant added to all pixels of all frames leaves the response unchanged."""
    takes_counts: ClassVar[bool] = False
    """True if frames must be photon counts: their noise sets the weights, so scaled frames give
    another response. The scale is then ignored."""
    minimum_frames: ClassVar[int] = 1
    place: ClassVar[float] = math.inf
    """Place in lists and legends; methods without one follow, by name"""

    name: Annotated[str, Field(min_length=1)]
    """Short name, as in the literature"""
    label: Annotated[str, Field(min_length=1)]
    """Full name"""

    @property
    @abstractmethod
    def memory_frames(self) -> int:
        """Frames after which less than 1 % of the past remains in the response."""

    @property
    def noise_memory_frames(self) -> int:
        """Frames after which noise is at full strength, within 1 % of its power."""
        return self.memory_frames

    @abstractmethod
    def start(self, shape: tuple[int, int]) -> Responder:
        """Return the detector at rest, to process a sequence of frames (H, W) chunk by chunk.

        Raises ValueError if frames of this shape are too small for the detector.
        """

    def after(self, frames: Frames, scale: float) -> Callable[[float], Responder]:
        """Return a function that starts the detector after `scale` · `frames` + an offset.

        It maps the offset to a responder as returned by `start`. There may be no frames.
        """

        def start(offset: float) -> Responder:
            respond = self.start((frames.shape[1], frames.shape[2]))
            if len(frames):
                respond(frames * scale + offset, 1.0)
            return respond

        return start

    @abstractmethod
    def scored(self, responses: Floats) -> Floats:
        """Return the values to be scored, (T, rows, columns, components), without borders."""

    def expected_deviation(self, means: Floats, scale: float) -> Floats | None:
        """Return E|response to counts − response to their means (T, H, W)|, as `respond`.

        None without a closed form, if counts must be drawn.
        """
        return None

    def respond(self, frames: Frames, scale: float = 1.0) -> Floats:
        """Return the responses to the sequence `scale` · `frames` (T, H, W).

        They are (T, H, W), or (T − 1, rows, columns, 2) in px per frame, NaN where undefined. The
        scale brings counts to common brightness, such as pixels / photons per frame; velocities do
        not depend on it. Raises ValueError if frames are too few or too small.
        """
        if frames.ndim != 3 or len(frames) < self.minimum_frames:
            raise ValueError(
                f"frames of shape {frames.shape}: {self.name} needs a sequence (T, H, W) of at"
                f" least {self.minimum_frames} frames"
            )
        return self.start((frames.shape[1], frames.shape[2]))(frames, scale)


def in_pairs(match: Callable[[Frames], Floats]) -> Responder:
    """Return a responder that passes every pair of neighboring frames to `match` exactly once.

    `match`: maps frames (n, H, W) to the results of their n − 1 pairs.
    """
    last: Frames | None = None

    def respond(frames: Frames, scale: float) -> Floats:
        nonlocal last
        joined = frames if last is None else np.concatenate((last, frames))
        last = frames[-1:].copy()
        return match(joined)

    return respond


def stacked(frames: Sequence[Frames]) -> Frames:
    """Return frames (H, W) as one array (T, H, W).

    Raises ValueError if they are not images, differ in shape, or have pixels that are NaN or
    infinite.
    """
    shapes = {frame.shape for frame in frames}
    if {len(shape) for shape in shapes} != {2} or len(shapes) > 1:
        differing = " and ".join(map(str, sorted(shapes)))
        raise ValueError(
            f"frames of shape {differing}: give images (H, W) of one channel and one size"
        )
    for number, frame in enumerate(frames, 1):
        if not np.isfinite(frame).all():
            raise ValueError(f"frame {number} has pixels that are not finite; fill them in")
    return np.stack(frames)
