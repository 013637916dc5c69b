"""Timing jitter: scatter of event time stamps about the arrival of the photon.

Normal with mean 0, the same for all events and independent between events. A share of the events
comes later by an exponential time, the diffusion tail: their carriers are set free below the
junction and diffuse there first. With this share p and the mean τ of that time, a stamp has

    mean p·τ       variance σ² + p·τ²·(2 − p)

Jitter moves time stamps only: which avalanches occur is decided before. Stamps may lie outside the
exposure, and their order may change; neither is corrected, as the event still belongs to its frame.

Source: dissertation §2.3.2; Ripamonti and Cova, Solid-State Electronics 28, 925 (1985), for the
tail.
"""

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from megalopta.core.arrays import Floats
from megalopta.sensor.effects.base import Effect, Stage


class Jitter(Effect, frozen=True):
    """Scatter of the time stamps; none by default."""

    stage: ClassVar[Stage] = Stage.READOUT
    statement: ClassVar[str] = "time stamps of events scatter (event streams only)"

    sigma_s: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of a time stamp (s)."""
    tail_share: Annotated[float, Field(ge=0, le=1, exclude_if=lambda share: share == 0)] = 0.0
    """Share of the events that come later by an exponential time (0 to 1)."""
    tail_s: Annotated[float, Field(ge=0, exclude_if=lambda mean: mean == 0)] = 0.0
    """Mean of that time (s)."""


def stamp(rng: np.random.Generator, times_s: Floats, jitter: Jitter) -> Floats:
    """Return time stamps (N,), s, of events at these times."""
    if not jitter.is_on:
        return times_s
    stamps = times_s + jitter.sigma_s * rng.standard_normal(times_s.size)
    if jitter.tail_share * jitter.tail_s > 0:
        is_late = rng.random(times_s.size) < jitter.tail_share
        stamps += is_late * rng.exponential(jitter.tail_s, times_s.size)
    return stamps
