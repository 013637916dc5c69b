"""Digital counter in the pixel, with limited capacity.

A digital counter of n bits holds up to 2ⁿ − 1 events. With one more it stays there (saturating) or
restarts at zero (wrapping). Readings that may stand for larger numbers are flagged: at capacity if
saturating, beyond it if wrapping. Below capacity, mean and variance are those of the events.

For the analog counter see `analog`.
"""

from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from megalopta.sensor.effects.base import Effect, Stage

LARGEST_CAPACITY = 2**32 - 1
"""Counts are stored in at most 32 bits."""

Counts = NDArray[np.uint16] | NDArray[np.uint32]


class DigitalCounter(Effect, frozen=True):
    """Digital counter."""

    stage: ClassVar[Stage] = Stage.READOUT
    statement: ClassVar[str] = (
        "avalanches are counted, up to the counter's capacity, and read (frames only)"
    )

    kind: Literal["digital"] = "digital"
    """Kind of counter: digital or analog."""
    capacity: Annotated[int, Field(ge=1, le=LARGEST_CAPACITY)] = LARGEST_CAPACITY
    """Largest count: 2ⁿ − 1 for n bits."""
    overflow: Literal["saturate", "wrap"] = "saturate"
    """Behavior at overflow: stay at capacity (saturate) or restart at zero (wrap)."""

    @property
    def is_on(self) -> bool:
        """True if it can saturate."""
        return self.capacity < LARGEST_CAPACITY


def read_digital(
    events: NDArray[np.int64], counter: DigitalCounter, out: tuple[Counts, NDArray[np.bool_]]
) -> None:
    """Write counts into `out`, and True where they are unreliable, for events of any shape."""
    counts, saturated = out
    if counter.overflow == "wrap":
        np.remainder(events, counter.capacity + 1, out=counts, casting="unsafe")
        np.greater(events, counter.capacity, out=saturated)
    else:
        np.minimum(events, counter.capacity, out=counts, casting="unsafe")
        np.greater_equal(events, counter.capacity, out=saturated)


def empty_counts(shape: tuple[int, ...], capacity: int) -> Counts:
    """Array for counts, of the smaller unsigned type that holds the capacity."""
    if capacity <= np.iinfo(np.uint16).max:
        return np.empty(shape, np.uint16)
    return np.empty(shape, np.uint32)
