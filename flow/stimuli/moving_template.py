"""Clean frames of the flow benchmark: a template that moves past a window (dissertation, §4.2).

A template is a full turn of the surroundings, (rows, columns), and a frame is a square window of as
many columns as rows; frame t sees the template shifted by +v·t columns, around the circle, so its
content moves to the right.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import correlate1d

from megalopta.core.arrays import Floats
from megalopta.flow.detectors.base import Frames
from megalopta.flow.stimuli import photons


@dataclass(frozen=True)
class MovingTemplate:
    """View of a rotating camera, frame by frame."""

    template: Floats
    """(rows, columns), light of any unit; columns at least as many as rows"""
    velocity_px: int
    """Columns per frame, positive to the right"""
    size: int
    """Rows and columns of the frames after resizing (px)"""
    resize: photons.ResizeKind = "nearest"
    """Method of resizing"""

    def __post_init__(self) -> None:
        """Refuse an invalid template."""
        rows, columns = self.template.shape
        if columns < rows:
            raise ValueError(
                f"template of {rows} × {columns} px: give at least as many columns as rows"
            )
        if not (self.template.min() >= 0 and np.isfinite(self.template.sum())):
            raise ValueError("template holds negative or non-finite values: give light, 0 or more")
        photons.resized_shape((rows, rows), self.size)

    @cached_property
    def _lines(self) -> Floats:
        """Return the template with rows resized, and its first columns repeated at its end."""
        rows, columns = self.template.shape
        lines = photons.resize(self.template, (self.size, columns), self.resize)
        return np.concatenate((lines, lines[:, :rows]), axis=1)

    def light(self, shift_px: int, count: int) -> Floats:
        """Return frames as shares of the flux, (count, size, size), of sum 1 each.

        Raises BlackFrameError if a frame is black.

        `shift_px`: columns by which the template is shifted in the first frame.
        """
        rows, columns = self.template.shape
        starts = -(shift_px + self.velocity_px * np.arange(count)) % columns
        frames, sums = np.empty((count, self.size, self.size)), np.empty(count)
        for t, start in enumerate(starts):
            window = self._lines[:, start : start + rows]
            frames[t] = photons.resize(window, (self.size, self.size), self.resize)
            sums[t] = frames[t].sum()
        frames /= photons.not_black(sums)[:, np.newaxis, np.newaxis]
        return frames


def motion_blurred(template: Floats, length_px: float) -> Floats:
    """Return a template (H, W) with motion blur along its rows, around the circle.

    Each pixel becomes the mean over a line of this length, MATLAB's fspecial('motion', length, 0):
    taps are the shares of the line in each pixel.

    Raises ValueError if the length is negative.
    """
    if not length_px >= 0:
        raise ValueError(f"length_px {length_px:g}: give the length of the motion, 0 or more")
    if length_px <= 1:  # the line stays in its pixel
        return template
    reach = int(np.ceil((length_px - 1) / 2))
    offsets = np.arange(-reach, reach + 1)
    half = length_px / 2
    taps = np.minimum(offsets + 0.5, half) - np.maximum(offsets - 0.5, -half)
    return np.asarray(correlate1d(template, taps / length_px, axis=1, mode="wrap"))


def sum_frames(frames: Frames, window: int) -> Frames:
    """Return the sliding sum of `window` successive frames, (T − window + 1, H, W)."""
    if window == 1:
        return frames
    total = np.cumsum(frames, axis=0, dtype=frames.dtype if frames.dtype.kind == "f" else np.uint64)
    total[window:] -= total[:-window].copy()
    return total[window - 1 :]
