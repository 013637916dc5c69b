"""Selection of the frames and pixels to show, and their times and playback."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Item = TypeVar("Item")

PLAYBACK_HZ = (2.0, 30.0)
"""Frame rates at which a film can be followed (Hz)."""
_MOST_PIXELS_SHOWN = 8_000_000
"""Limit of all films of a page"""


@dataclass(frozen=True)
class Selection:
    """Frames shown, by number from 0, and step of the pixels shown."""

    frames: tuple[int, ...]
    step: int

    def pixels(self, images: NDArray[Any]) -> NDArray[Any]:
        """Return the shown pixels of images (..., H, W)."""
        return images[..., :: self.step, :: self.step]


def selection(
    frames: range, shape: tuple[int, int], films: int, longest_px: int, most_frames: int
) -> Selection:
    """Choose the frames and pixels that fit a page with this many films."""
    step = math.ceil(max(shape) / longest_px)
    fitting = _MOST_PIXELS_SHOWN * step**2 // (math.prod(shape) * films)
    return Selection(spread(frames, max(min(most_frames, fitting), 1)), step)


def spread(frames: range, most: int) -> tuple[int, ...]:
    """Return at most `most` of the frames, evenly spaced, starting with the first."""
    count = min(len(frames), most)
    return tuple(frames[index * len(frames) // count] for index in range(count))


def with_ends(items: Sequence[Item], most: int) -> list[Item]:
    """Return at most `most` of some items, evenly spaced, with the first and the last."""
    last, count = len(items) - 1, min(len(items), most)
    return [items[round(index * last / max(count - 1, 1))] for index in range(count)]


def frame_label(frame: int, times_s: NDArray[np.float64] | None, summed: int = 1) -> str:
    """Return the label of a frame, or of a sum of frames, with its time if known."""
    name = f"frame {frame + 1}" if summed == 1 else f"frames {frame + 1} to {frame + summed}"
    if times_s is None:
        return name
    period = float(times_s[-1] - times_s[0]) / max(len(times_s) - 1, 1)
    decimals = max(2, math.ceil(-math.log10(period))) if period > 0 else 2
    return f"{name} · {times_s[frame]:.{decimals}f} s"
