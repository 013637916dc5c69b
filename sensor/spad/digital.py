"""The counter in the pixel: it holds so many events and no more.

A digital counter of n bits holds 2ⁿ − 1. One more event and it stays there (saturating) or starts
again at zero (wrapping). A reading that may stand for a larger number is flagged: at capacity where
it saturates, past it where it wraps. Without that, mean and variance are those of the events.

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
    """A digital counter."""

    stage: ClassVar[Stage] = Stage.READOUT
    statement: ClassVar[str] = (
        "avalanches are counted, as far as the counter goes, and read (frames only)"
    )

    kind: Literal["digital"] = "digital"
    """Counts in bits."""
    capacity: Annotated[int, Field(ge=1, le=LARGEST_CAPACITY)] = LARGEST_CAPACITY
    """Largest count it can hold (counts): 2ⁿ − 1 for n bits."""
    overflow: Literal["saturate", "wrap"] = "saturate"
    """What one event too many does: nothing, or start again at zero."""

    @property
    def is_on(self) -> bool:
        """Whether it is ever full."""
        return self.capacity < LARGEST_CAPACITY


def read_digital(
    events: NDArray[np.int64], counter: DigitalCounter, out: tuple[Counts, NDArray[np.bool_]]
) -> None:
    """Fill in counts, and where they are not to be trusted, of as many events, of any shape."""
    counts, saturated = out
    if counter.overflow == "wrap":
        np.remainder(events, counter.capacity + 1, out=counts, casting="unsafe")
        np.greater(events, counter.capacity, out=saturated)
    else:
        np.minimum(events, counter.capacity, out=counts, casting="unsafe")
        np.greater_equal(events, counter.capacity, out=saturated)


def empty_counts(shape: tuple[int, ...], capacity: int) -> Counts:
    """Array of a shape for counts, of the smaller unsigned type that holds the capacity."""
    if capacity <= np.iinfo(np.uint16).max:
        return np.empty(shape, np.uint16)
    return np.empty(shape, np.uint32)
