"""Timing jitter: scatter of event time stamps about the arrival of the photon.

Normal, mean 0, the same for all events and independent between events. It moves time stamps only:
which avalanches occur is decided before. Stamps may lie outside the exposure, and their order may
change; neither is corrected, as the event still belongs to its frame.

Source: dissertation §2.3.2; a normal distribution has no diffusion tail, unlike real devices.
"""

from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from megalopta.sensor.effects.base import Effect, Stage


class Jitter(Effect, frozen=True):
    """Scatter of the time stamps; none by default."""

    stage: ClassVar[Stage] = Stage.READOUT
    statement: ClassVar[str] = "time stamps of events scatter (event streams only)"

    sigma_s: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of a time stamp (s)."""


def stamp(
    rng: np.random.Generator, times_s: NDArray[np.float64], jitter: Jitter
) -> NDArray[np.float64]:
    """Return time stamps (N,), s, of events, with their times as mean and variance σ²."""
    if not jitter.is_on:
        return times_s
    return times_s + jitter.sigma_s * rng.standard_normal(times_s.size)
