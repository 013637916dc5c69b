"""Shutter: exposure time of each line, row or column, and delay between the first and the last."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.core.record import Record


class Shutter(Record, frozen=True):
    """Motion blur and rolling shutter; by default neither: every frame is taken at an instant."""

    exposure_s: Annotated[float, Field(ge=0)] = 0.0
    """Exposure time of each line (s); 0: no blur. The light that a sensor counts follows from its
    own exposure_s: give both the same value."""
    poses: Annotated[int, Field(ge=1, le=10_000)] = 8
    """Instants per exposure at which moving objects are placed; they share the samples per pixel.
    Steps in the blur vanish with one instant per px that the fastest object moves. The camera
    moves smoothly, by 64 or more poses per exposure."""
    readout_s: Annotated[float, Field(ge=0)] = 0.0
    """Rolling shutter: time from the middle of the first line's exposure to the last line's (s);
    0 exposes all lines at once."""
    readout_from: Literal["top", "bottom", "left", "right"] = Field(
        default="top", exclude_if=lambda side: side == "top"
    )
    """Side of the line that a rolling shutter exposes first: rows from the top or bottom, columns
    from the left or right. Other than top: a camera mounted upside down or on its side."""

    @property
    def is_instant(self) -> bool:
        """True if frames are taken at an instant, all lines at once."""
        return self.exposure_s == 0 and self.readout_s == 0

    @property
    def across(self) -> int:
        """Image coordinate that differs between lines: 0, x, of columns; 1, y, of rows."""
        return 0 if self.readout_from in ("left", "right") else 1

    def delay_s(self, place: Floats, size: int) -> Floats:
        """Delay of places across the lines of an image (px) relative to the frame's time, s.

        It holds at the centers of lines, is interpolated between and extrapolated beyond them.
        """
        way_s = self.readout_s if self.readout_from in ("top", "left") else -self.readout_s
        return np.asarray(way_s * ((place - 0.5) / max(size - 1, 1) - 0.5))
