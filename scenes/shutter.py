"""When light is taken in: how long each row is open, and how much later than the first the last is.

A frame's time is the middle of the exposure of its middle row.
"""

from typing import Annotated

import numpy as np
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.core.record import Record


class Shutter(Record, frozen=True):
    """Motion blur and rolling shutter; by default neither, every frame is taken at an instant."""

    exposure_s: Annotated[float, Field(ge=0)] = 0.0
    """Time that each row is open (s); 0 blurs nothing. How much light a sensor counts follows from
    its own exposure_s: give both alike."""

    poses: Annotated[int, Field(ge=1, le=10_000)] = 8
    """Instants of the exposure at which moving objects are put; they share the samples per pixel.
    As many as the fastest object moves in px leave no steps. The camera moves without any, by 64
    or more poses per exposure."""

    readout_s: Annotated[float, Field(ge=0)] = 0.0
    """Rolling shutter: time from the middle of the first row's exposure to the last row's (s);
    0 exposes all rows at once."""

    @property
    def is_instant(self) -> bool:
        """Whether frames are taken at an instant, all rows at once."""
        return self.exposure_s == 0 and self.readout_s == 0

    def delay_s(self, y: Floats, height: int) -> Floats:
        """Time from the frame's to that of places y (px from the upper edge) in the image, s.

        Rows have it at their center; between them it is interpolated, beyond them extrapolated.
        """
        return np.asarray(self.readout_s * ((y - 0.5) / max(height - 1, 1) - 0.5))
