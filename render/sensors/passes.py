"""A frame in passes: strips of rows and, where a row alone is too much, repeats of it.

A kernel that runs cannot be interrupted, holds its whole strip in memory and numbers its samples
with 32 bits; so no pass is long. Strips come first because they leave each pixel's stratified
samples together: 64 at once are a fifth less noisy than four times 16.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from megalopta.render import frame_seed

Trace = Callable[[int, int], NDArray[np.floating]]
"""Renders the strip (rows, W, B) that begins at a given row, with a given seed."""


@dataclass(frozen=True)
class Passes:
    """How a frame is divided."""

    height: int
    """Rows of the frame."""
    rows: int
    """Rows of a strip; the last one may reach beyond the frame."""
    samples: int
    """Light paths per pixel and pass."""
    repeats: int
    """Passes over each strip."""

    def render(self, trace: Trace, seed: int) -> NDArray[np.float64]:
        """Put a frame (H, W, B) together; the first pass has its seed, others derive theirs."""
        strips = [
            sum(
                trace(first, pass_seed(seed, number * self.repeats + repeat)).astype(np.float64)
                for repeat in range(self.repeats)
            )
            / self.repeats
            for number, first in enumerate(range(0, self.height, self.rows))
        ]
        return np.concatenate(strips)[: self.height]


def plan_passes(width: int, height: int, samples: int, most: int) -> Passes:
    """Divide a frame into as few passes as hold at most so many samples each.

    One sample of every pixel of a row is the least that a pass holds.
    """
    strips = math.ceil(height / max(most // (width * samples), 1))
    repeats = math.ceil(samples / max(most // width, 1))
    return Passes(height, math.ceil(height / strips), math.ceil(samples / repeats), repeats)


def pass_seed(seed: int, number: int) -> int:
    """Mitsuba's 32-bit seed of one pass of a frame; the first keeps the frame's."""
    if number == 0:
        return seed
    return frame_seed(seed, number)
