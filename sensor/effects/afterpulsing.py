"""Afterpulsing: trapped carriers of an avalanche that fire the pixel again later.

Every counted avalanche fills a Poisson number of traps, of mean p < 1. Each carrier is released
after a random delay, exponential or tabulated, and fires the pixel if it is live. A carrier
released during the dead time is lost, and extends a paralyzable one, as any arrival does. Outside
the gate it is lost without effect. Afterpulses fill traps too, so they have afterpulses. Arrivals
that only extend a paralyzable dead time fill no traps: the pixel is not recharged and little charge
flows.

Without dead time this is a Hawkes process with 1/(1−p) counts per primary on average. With
primaries at a rate r, a long exposure has r·T/(1−p) counts on average, with variance r·T/(1−p)³.

Source: dissertation §2.3.2; Hawkes, Biometrika 58, 83 (1971).
"""

from typing import Annotated, ClassVar, Self

import numpy as np
from pydantic import Field, model_validator

from megalopta.core.arrays import Floats
from megalopta.core.compiling import compiled
from megalopta.sensor.effects.base import Effect


class Afterpulsing(Effect, frozen=True):
    """Trapped carriers and their release; off by default."""

    switch: ClassVar[str] = "mean_carriers"

    mean_carriers: Annotated[float, Field(ge=0, le=0.95)] = 0.0
    """Mean number of carriers that an avalanche leaves in traps (0: no afterpulsing)."""
    delay_s: Annotated[float, Field(gt=0)] = 50e-9
    """Mean of the exponential release time (s); ignored with a table."""
    table_delays_s: tuple[Annotated[float, Field(ge=0)], ...] = ()
    """Delays of a measured distribution, increasing (s); empty: exponential."""
    table_cumulative: tuple[Annotated[float, Field(ge=0, le=1)], ...] = ()
    """Fraction of carriers released up to each of these delays, rising from 0 to 1."""
    mismatch_sigma: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Relative standard deviation over the pixels of the number of carriers (log-normal)."""

    @model_validator(mode="after")
    def _check_table(self) -> Self:
        delays, cumulative = np.array(self.table_delays_s), np.array(self.table_cumulative)
        rises = (np.diff(delays) > 0).all() and (np.diff(cumulative) >= 0).all()
        ends = [*self.table_cumulative[:1], *self.table_cumulative[-1:]]
        if (delays.size or ends) and not (
            delays.size == cumulative.size and rises and ends == [0, 1]
        ):
            raise ValueError(
                f"afterpulsing: table_delays_s {delays.tolist()} and table_cumulative "
                f"{cumulative.tolist()}; give increasing delays, and for each a fraction that does "
                "not fall, from 0 to 1"
            )
        return self

    @property
    def memory_s(self) -> float:
        """Time after which a pixel has forgotten its past except for a part in e²⁰, s."""
        delay = self.table_delays_s[-1] if self.table_delays_s else self.delay_s
        return 20 * delay / (1 - self.mean_carriers)


@compiled
def draw_carriers(rng: np.random.Generator, mean: float) -> int:
    """Number of carriers that an avalanche leaves in traps (Poisson, small mean)."""
    carriers, product, limit = 0, rng.random(), np.exp(-mean)
    while product > limit:
        product *= rng.random()
        carriers += 1
    return carriers


@compiled
def draw_delay(
    rng: np.random.Generator, delay_s: float, table_delays_s: Floats, table_cumulative: Floats
) -> float:
    """Time from avalanche to release of one carrier, s; exponential if the table is empty."""
    if table_delays_s.size == 0:
        exponential: float = delay_s * rng.standard_exponential()
        return exponential
    # as np.interp, which would allocate for every carrier and takes seconds to compile
    chance, low, high = rng.random(), 0, table_cumulative.size - 1
    while high - low > 1:
        middle = (low + high) // 2
        if table_cumulative[middle] <= chance:
            low = middle
        else:
            high = middle
    rise = table_cumulative[high] - table_cumulative[low]
    slope = (table_delays_s[high] - table_delays_s[low]) / rise
    delay: float = slope * (chance - table_cumulative[low]) + table_delays_s[low]
    return delay
