"""Shutter: exposure time of each row, and delay between the first and the last row.

A frame's time is the middle of the exposure of its middle row.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.core.record import Record


class Shutter(Record, frozen=True):
    """Motion blur and rolling shutter; by default neither: every frame is taken at an instant."""

    exposure_s: Annotated[float, Field(ge=0)] = 0.0
    """Exposure time of each row (s); 0: no blur. The light that a sensor counts follows from its
    own exposure_s: give both the same value."""

    poses: Annotated[int, Field(ge=1, le=10_000)] = 8
    """Instants per exposure at which moving objects are placed; they share the samples per pixel.
    Steps in the blur vanish with one instant per px that the fastest object moves. The camera
    moves smoothly, by 64 or more poses per exposure."""

    readout_s: Annotated[float, Field(ge=0)] = 0.0
    """Rolling shutter: time from the middle of the first row's exposure to the last row's (s);
    0 exposes all rows at once."""

    readout_from: Literal["top", "bottom"] = Field(
        default="top", exclude_if=lambda side: side == "top"
    )
    """Row that a rolling shutter exposes first: top, or bottom of a camera mounted upside down."""

    @property
    def is_instant(self) -> bool:
        """True if frames are taken at an instant, all rows at once."""
        return self.exposure_s == 0 and self.readout_s == 0

    def delay_s(self, y: Floats, height: int) -> Floats:
        """Delay of places y (px from the upper edge) in the image relative to the frame's time, s.

        It holds at the centers of rows, is interpolated between and extrapolated beyond them.
        """
        way_s = self.readout_s if self.readout_from == "top" else -self.readout_s
        return np.asarray(way_s * ((y - 0.5) / max(height - 1, 1) - 0.5))
