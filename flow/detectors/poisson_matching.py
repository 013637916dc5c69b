"""Block matching by Poisson likelihood (PM): two frames, a scale of its own, fractions of a pixel.

As in block matching, each block of frame t + 1 is compared with the equally large parts of frame t
around it. Three things differ, and each takes it closer to the bound of `translation_bound`: the
difference is that of a likelihood of counts (`shift_cost`); each block is smoothed, and its pixels
weighed, as its own counts ask for (`shot_noise_blur`); and the best shift is interpolated between
pixels.

A block uses its own pixels, those that the search compares them with, and what the smoothing mixes
into both, 6 px at most; the weights look a little further. It needs nothing else of the frame
(`efficiency.confined_velocities` cuts all else away). A block without photons, or whose costs are
all equal, has no velocity (NaN).
"""

from typing import Annotated, ClassVar

from pydantic import Field

from megalopta.flow.detectors.base import Responder
from megalopta.flow.detectors.block_detector import BlockDetector
from megalopta.flow.detectors.block_matching import thesis_radius_px
from megalopta.flow.detectors.block_pairs import neighbor_shifts
from megalopta.flow.detectors.shot_noise_blur import SmoothedFrame


class PoissonMatching(BlockDetector, frozen=True):
    """Velocity of each block by the likelihood of its counts in two frames."""

    place: ClassVar[float] = 12
    ignores_offset: ClassVar[bool] = False
    takes_counts: ClassVar[bool] = True

    name: str = "PM"
    """Short name"""

    label: str = "Poisson matching"
    """Name in words"""

    radius_px: Annotated[int, Field(ge=1)] | None = None
    """Largest shift searched in x and in y (px per frame); by default as block matching"""

    def start(self, shape: tuple[int, int]) -> Responder:
        """Return the search for frames (H, W); see `Detector.start`."""
        grid, radius = self.grid(shape), self.radius_px or thesis_radius_px(shape)
        return self.over_window(
            grid, lambda window, scale: neighbor_shifts(window, grid, radius), SmoothedFrame
        )
