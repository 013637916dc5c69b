"""Poisson matching pooled over up to eight frames of one velocity (PPM).

n frames of a texture that moves steadily tell its velocity v with a variance of no less than
1/(J·Σ(t − t̄)²), which is 2/J for two frames and 1/(42·J) for eight: a displacement over five
frames is measured no worse than one over one. So the search goes from short to long baselines:

1. The correlations of all pairs of frames are searched for the velocity that they agree on
   (`all_pairs`). Where texture is weaker than the shot noise of all frames, that is the answer.
2. Pairs a third of the frames apart are compared, as in `poisson_matching`, near the displacement
   expected from 1.
3. Pairs two thirds apart likewise; their displacement over their distance is the velocity. With
   eight frames these are three pairs without a common frame, whose variance is 1/(37.5·J): the
   pairs in between would add a ninth.

Blocks ride with the content: each is displaced half of the way back and half of the way forth, so
that long baselines stay near the block and inside the frame. Velocities are those of the newest
pair under the assumption that nothing has accelerated since the oldest frame; at the start of a
sequence there are fewer frames to pool.
"""

from typing import ClassVar

import numpy as np

from megalopta.flow.detectors.all_pairs import Patches, agreed_velocities
from megalopta.flow.detectors.base import FloatArray, Frames, Responder
from megalopta.flow.detectors.block_matching import thesis_radius_px
from megalopta.flow.detectors.block_pairs import BlockPairs
from megalopta.flow.detectors.poisson_matching import PoissonMatching
from megalopta.flow.detectors.pooled_frames import PooledFrames
from megalopta.flow.detectors.shot_noise_blur import SmoothedFrame

_REFINING_RADIUS_PX = 2
"""Largest error of an expected displacement; one at this edge is refused."""

_CLEAR = 1.0
"""Texture over the shot noise of all frames from which comparing blocks beats correlation"""


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
            return _refined(agreed_velocities(patches, radius), BlockPairs(smoothed, grid, radius))

        return self.over_window(grid, velocity, prepared)


def _refined(velocities: FloatArray, pairs: BlockPairs) -> FloatArray:
    """Return velocities (blocks, 2) from longer baselines, where there is light enough."""
    is_clear = pairs.texture_over_noise[:, np.newaxis] >= _CLEAR
    for baseline in baselines(len(pairs)):
        expected = np.rint(np.nan_to_num(velocities * baseline)).astype(np.int64)
        shifts = pairs.shifts(baseline, expected, _REFINING_RADIUS_PX)
        inside = np.abs(shifts - expected).max(axis=1, keepdims=True) < _REFINING_RADIUS_PX
        velocities = np.where(inside & is_clear, shifts / baseline, velocities)
    return velocities


def baselines(frames: int) -> list[int]:
    """Return the distances in time by which a velocity from neighboring frames is refined.

    Of pairs k of n frames apart, n − k pairs tell the velocity with a weight of k² each; those
    2n/3 apart tell most.
    """
    return sorted({round(frames / 3), round(2 * frames / 3)} - {0, 1})
