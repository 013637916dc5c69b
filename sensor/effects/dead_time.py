"""Dead time: arrivals lost while a detector recovers from the previous event.

Three kinds. `ideal`: none, counts are Poisson. `nonparalyzable` and `paralyzable`: see the modules
of these names for the distributions. In all of them τ is the same for every event and the rate is
constant during the exposure. When the exposure starts, the detector is live and idle, or it has
been running for long (`stationary`) and may be dead.

A non-paralyzable dead time may end gradually, in twilight pulses or while the pixel recharges;
these are simulated (`megalopta.sensor.spad`). Definitions and limits: `docs/theory/dead-time.md`.

Source: Straka et al., J. Lightwave Technol. 38, 4765 (2020), arXiv 2001.10036, for twilight pulses
with the rate times a constant α for probability; Krause and Walenta, arXiv 2507.10361, for the
recovery of the efficiency.
"""

from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from megalopta.core.arrays import Floats, Ints
from megalopta.sensor.effects import nonparalyzable, paralyzable
from megalopta.sensor.effects.base import Effect
from megalopta.sensor.sampling.poisson import draw_poisson

MOST_ARRIVALS = 1e15
# Far below that of any detector; denormal times have no finite inverse.
_SHORTEST_S = 1e-15
COUNT_DISTRIBUTIONS = {"nonparalyzable": nonparalyzable, "paralyzable": paralyzable}
"""Modules with `moments` and `draw` of the counts of each kind."""


class DeadTime(Effect, frozen=True):
    """Recovery of a pixel after an event."""

    kind: Literal["ideal", "nonparalyzable", "paralyzable"] = "ideal"
    """ideal: no dead time; nonparalyzable, active quench: arrivals in it are lost; paralyzable,
    passive quench: they also extend it."""
    dead_time_s: Annotated[float, Field(ge=0)] = 0.0
    """Time during which the pixel is dead (s), at least 1e-15; 0 with ideal."""
    twilight_s: Annotated[float, Field(ge=0)] = 0.0
    """Last part of the dead time (s) in which an arrival gives a count at its end; 0: none."""
    recharge_s: Annotated[float, Field(ge=0)] = 0.0
    """Time constant of the efficiency's recovery after the dead time (s); 0: at once."""
    mismatch_sigma: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Relative standard deviation of the dead time over the pixels (log-normal)."""
    start: Literal["live", "stationary"] = "live"
    """State at the start of an exposure: live, as reset, or stationary, as after a long run."""

    @model_validator(mode="after")
    def _check_dead_time(self) -> Self:
        if self.kind == "ideal" and self.dead_time_s > 0:
            raise ValueError(
                f"dead_time.dead_time_s: {self.dead_time_s:g} has no effect with kind 'ideal'; use "
                "kind 'nonparalyzable' or 'paralyzable', or omit the time"
            )
        if self.kind != "ideal" and self.dead_time_s < _SHORTEST_S:
            raise ValueError(
                f"dead_time.dead_time_s: {self.dead_time_s:g} is below {_SHORTEST_S:g} s "
                f"with kind {self.kind!r}; give a time or use kind 'ideal'"
            )
        is_known = self.kind == "nonparalyzable" and 0 in (self.twilight_s, self.recharge_s)
        if not self.is_closed_form and not is_known:
            raise ValueError(
                f"dead_time: twilight_s {self.twilight_s:g} and recharge_s {self.recharge_s:g} "
                f"with kind {self.kind!r}; give one of them, with kind 'nonparalyzable'"
            )
        if self.twilight_s > self.dead_time_s / 2:
            raise ValueError(
                f"dead_time.twilight_s: {self.twilight_s:g} is more than half of dead_time_s "
                f"{self.dead_time_s:g}; lower it"
            )
        return self

    @property
    def is_on(self) -> bool:
        """True if anything is lost."""
        return self.kind != "ideal"

    @property
    def is_closed_form(self) -> bool:
        """True if the counts can be drawn directly: no twilight or recharging."""
        return self.twilight_s == 0 and self.recharge_s == 0


def moments(
    rate_hz: ArrayLike, exposure_s: float, dead_time: DeadTime, scale: ArrayLike = 1.0
) -> tuple[Floats, Floats]:
    """Exact mean and variance of the number of counts in one exposure.

    Raises ValueError if a rate or the exposure is negative or not finite.

    `rate_hz` of any shape: rate of arrivals, photons and dark counts together; `dead_time`: without
    twilight and recharging; `scale`: factor on each pixel's dead time.
    """
    arrivals = check_arrivals(rate_hz, exposure_s)
    fractions = _fractions(arrivals, exposure_s, dead_time, scale)
    distribution = COUNT_DISTRIBUTIONS.get(dead_time.kind)
    mean, variance = (
        distribution.moments(arrivals, *fractions) if distribution else (arrivals, arrivals.copy())
    )
    return mean.reshape(np.shape(rate_hz)), variance.reshape(np.shape(rate_hz))


def draw_counts(
    rng: np.random.Generator,
    rate_hz: ArrayLike,
    exposure_s: float,
    dead_time: DeadTime,
    scale: ArrayLike = 1.0,
) -> Ints:
    """Draw the number of counts in one exposure; as `moments`."""
    arrivals = check_arrivals(rate_hz, exposure_s)
    fractions = _fractions(arrivals, exposure_s, dead_time, scale)
    distribution = COUNT_DISTRIBUTIONS.get(dead_time.kind)
    counts = (
        distribution.draw(rng, arrivals, *fractions)
        if distribution
        else draw_poisson(rng, arrivals)
    )
    return np.asarray(counts.reshape(np.shape(rate_hz)))


def _fractions(
    arrivals: Floats, exposure_s: float, dead_time: DeadTime, scale: ArrayLike
) -> tuple[Floats, bool]:
    """Dead time over exposure of every pixel, flat, and True for a stationary start."""
    fraction = dead_time.dead_time_s / exposure_s * np.asarray(scale, np.float64).ravel()
    return np.broadcast_to(fraction, arrivals.shape), dead_time.start == "stationary"


def check_arrivals(rate_hz: ArrayLike, exposure_s: float) -> Floats:
    """Return the mean number of arrivals per exposure, flat (N,); raise if invalid."""
    if not 0 < exposure_s < np.inf:
        raise ValueError(f"exposure_s: {exposure_s}; must be positive and finite (s)")
    rate = np.asarray(rate_hz, np.float64).ravel()
    if rate.size and not (rate.min() >= 0 and rate.max() * exposure_s <= MOST_ARRIVALS):
        raise ValueError(
            f"rate_hz: from {rate.min():g} to {rate.max():g}; must be finite, not negative, and at "
            f"most {MOST_ARRIVALS / exposure_s:g} Hz ({MOST_ARRIVALS:g} arrivals per exposure)"
        )
    return rate * exposure_s
