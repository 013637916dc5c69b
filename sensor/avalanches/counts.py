"""Counts of a frame and their mean and variance, by the cheapest exact way.

    dead time alone                       its own law (`dead_time`)
    gate alone                            Poisson, in the time the gate is open
    crosstalk alone                       Poisson, then generation after generation (`crosstalk`)
    anything else                         simulated avalanche by avalanche (`avalanches`)

The mean and variance of a pixel are those of `pixel_moments`. Crosstalk together with dead time or
afterpulsing enters them as light from the mean counts of the neighbors, which leaves out that such
light comes at the time of an event.
"""

import numpy as np
from numpy.typing import NDArray

from megalopta.sensor.avalanches.moments import open_rate, pixel_moments
from megalopta.sensor.avalanches.simulation import AvalancheEffects, simulate_counts
from megalopta.sensor.effects import Crosstalk, check_arrivals, crosstalk, dead_time, open_fraction

_ROUNDS_OF_CROSSTALK = 60

Floats = NDArray[np.float64]


def draw_counts(
    rng: np.random.Generator, rate_hz: Floats, exposure_s: float, effects: AvalancheEffects
) -> NDArray[np.int64]:
    """Draw the counts of one exposure.

    Parameters
    ----------
    rng : numpy.random.Generator
    rate_hz : (rows, columns) float64
        Rate of photons that would be detected and of dark counts, together.
    exposure_s : float
    effects : AvalancheEffects
    """
    if _is_simple(effects):
        open_hz = open_rate(rate_hz, exposure_s, effects)
        primaries = dead_time.draw_counts(rng, open_hz, exposure_s, effects.dead_time)
        return crosstalk.spread(rng, primaries, effects.crosstalk)
    check_arrivals(rate_hz, exposure_s)
    return simulate_counts(rng, rate_hz, exposure_s, effects)


def count_moments(
    rate_hz: Floats, exposure_s: float, effects: AvalancheEffects
) -> tuple[Floats, Floats]:
    """Mean and variance of the counts of one exposure; as `draw_counts`."""
    if not effects.crosstalk.is_on:
        return pixel_moments(rate_hz, exposure_s, effects)
    if _is_simple(effects):
        primaries = open_rate(rate_hz, exposure_s, effects) * exposure_s
        return (
            crosstalk.mean(primaries, effects.crosstalk),
            crosstalk.variance(primaries, effects.crosstalk),
        )
    return _moments_with_light_of_neighbors(rate_hz, exposure_s, effects)


def _is_simple(effects: AvalancheEffects) -> bool:
    """Whether the counts of a pixel have a law that can be drawn from."""
    return effects.on <= {"gate", "crosstalk"} or effects.on == {"dead_time"}


def _moments_with_light_of_neighbors(
    rate_hz: Floats, exposure_s: float, effects: AvalancheEffects
) -> tuple[Floats, Floats]:
    alone = effects._replace(crosstalk=Crosstalk())
    open_s = exposure_s * open_fraction(effects.gate, exposure_s)
    rate = rate_hz
    mean, variance = pixel_moments(rate, exposure_s, alone)
    for _ in range(_ROUNDS_OF_CROSSTALK):
        light = crosstalk.fired_mean(mean, effects.crosstalk) / open_s
        before, rate = rate, rate_hz + light
        mean, variance = pixel_moments(rate, exposure_s, alone)
        if np.allclose(rate, before, rtol=1e-9):
            break
    return mean, variance
