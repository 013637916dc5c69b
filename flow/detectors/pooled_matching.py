"""Poisson matching pooled over up to eight frames of one velocity (PPM).

n frames of a texture that moves steadily tell its velocity v with a variance of no less than
1/(J·Σ(t − t̄)²), which is 2/J for two frames and 1/(42·J) for eight. Two steps come near it:

1. The correlations of all pairs of frames are searched for the velocity that they agree on
   (`all_pairs`).
2. From there the frames are laid over one another, and the velocity at which they are most alike is
   found to fractions of a pixel (`frame_alignment`).

Blocks ride with the content: each lies at its place in the middle of the frames' time. Velocities
are those of the newest pair under the assumption that nothing has accelerated since the oldest
frame; at the start of a sequence there are fewer frames to pool.
"""

from typing import ClassVar

from megalopta.flow.detectors.all_pairs import Patches, agreed_velocities
from megalopta.flow.detectors.base import FloatArray, Frames, Responder
from megalopta.flow.detectors.block_matching import thesis_radius_px
from megalopta.flow.detectors.frame_alignment import aligned
from megalopta.flow.detectors.poisson_matching import PoissonMatching
from megalopta.flow.detectors.pooled_frames import PooledFrames
from megalopta.flow.detectors.shot_noise_blur import SmoothedFrame


class PooledMatching(PooledFrames, PoissonMatching, frozen=True):
    """Velocity of each block by the likelihood of its counts in several frames."""

    place: ClassVar[float] = 13

    name: str = "PPM"
    """Short name"""

    label: str = "Pooled Poisson matching"
    """Name in words"""

    def start(self, shape: tuple[int, int]) -> Responder:
        """Return the search for frames (H, W); see `Detector.start`."""
        grid, radius = self.grid(shape), self.radius_px or thesis_radius_px(shape)

        def prepared(frame: Frames) -> tuple[SmoothedFrame, Patches]:
            return SmoothedFrame(frame), Patches(frame, grid, radius)

        def velocity(window: list[tuple[SmoothedFrame, Patches]], scale: float) -> FloatArray:
            smoothed, patches = zip(*window, strict=True)
            return aligned(smoothed, grid, radius, agreed_velocities(patches, radius))

        return self.over_window(grid, velocity, prepared)
