"""Counts of a frame and their mean and variance, by the cheapest exact way.

    dead time alone                       its own law (`dead_time`)
    gate alone                            Poisson, in the time the gate is open
    crosstalk alone                       Poisson, then generation after generation (`crosstalk`)
    anything else                         simulated avalanche by avalanche (`simulation`)

The mean and variance of a pixel are those of `moments`, with crosstalk those of `coupled`.
"""

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.sensor.avalanches.coupled import coupled_moments
from megalopta.sensor.avalanches.moments import open_rate, pixel_moments
from megalopta.sensor.avalanches.simulation import simulate_counts
from megalopta.sensor.effects import crosstalk, dead_time
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.effects.dead_time import check_arrivals
from megalopta.sensor.effects.fields import AvalancheEffects
from megalopta.sensor.effects.gating import part_weights


def draw_counts(
    rng: np.random.Generator,
    rate_hz: Floats,
    exposure_s: float,
    effects: AvalancheEffects,
    maps: AvalancheMaps | None = None,
) -> NDArray[np.int64]:
    """Draw the counts of one exposure.

    Parameters
    ----------
    rng : numpy.random.Generator
    rate_hz : (rows, columns) or (S, rows, columns) float64
        Rate of photons that would be detected and of dark counts, together; constant, or in S equal
        parts of the exposure.
    exposure_s : float
    effects : AvalancheEffects
    maps : AvalancheMaps, optional
        How pixels differ; by default not at all.
    """
    if rate_hz.ndim == 3 and not effects.remembers:
        rate_hz = mean_rate(rate_hz, exposure_s, effects)
    if rate_hz.ndim == 2 and _is_simple(effects):
        open_hz = open_rate(rate_hz, exposure_s, effects)
        scale = 1.0 if maps is None else maps.dead_time
        primaries = dead_time.draw_counts(rng, open_hz, exposure_s, effects.dead_time, scale)
        return crosstalk.spread(rng, primaries, effects.crosstalk, _strength(maps))
    check_arrivals(rate_hz, exposure_s)
    return simulate_counts(rng, rate_hz, exposure_s, effects, maps)


def count_moments(
    rate_hz: Floats,
    exposure_s: float,
    effects: AvalancheEffects,
    maps: AvalancheMaps | None = None,
) -> tuple[Floats, Floats]:
    """Mean and variance (rows, columns) of the counts of one exposure; parameters as `draw_counts`.

    Of rates in parts they are those of exposures at the rate of every part, weighed with its share
    of the time open: exact without dead time and afterpulsing, else but for what a part inherits of
    the one before. With dead time alone, two pixels under the same arrivals differ by one count at
    most from any moment on, and by none if both are live then: at each of the S − 1 borders, and by
    how the exposure starts, the mean is off by no more than the share of time that a part is dead.
    With afterpulses each of these counts has 1/(1 − p) in all, and the carriers that wait at a
    border come on top.
    """
    if rate_hz.ndim == 3 and effects.remembers:
        weights = part_weights(effects.gate, exposure_s, len(rate_hz))
        moments = [count_moments(part, exposure_s, effects, maps) for part in rate_hz]
        mean, variance = np.tensordot(weights, moments, 1)
        return mean, variance
    if rate_hz.ndim == 3:
        rate_hz = mean_rate(rate_hz, exposure_s, effects)
    if not effects.crosstalk.is_on:
        return pixel_moments(rate_hz, exposure_s, effects, maps)
    if _is_simple(effects):
        primaries = open_rate(rate_hz, exposure_s, effects) * exposure_s
        return (
            crosstalk.mean(primaries, effects.crosstalk, _strength(maps)),
            crosstalk.variance(primaries, effects.crosstalk, _strength(maps)),
        )
    return coupled_moments(rate_hz, exposure_s, effects, maps)


def mean_rate(rate_hz: Floats, exposure_s: float, effects: AvalancheEffects) -> Floats:
    """Mean over the time open of rates in parts (S, rows, columns), Hz."""
    weights = part_weights(effects.gate, exposure_s, len(rate_hz))
    return np.asarray(np.tensordot(weights, rate_hz, 1))


def _strength(maps: AvalancheMaps | None) -> Floats | None:
    return None if maps is None else maps.crosstalk


def _is_simple(effects: AvalancheEffects) -> bool:
    """Whether the counts of a pixel have a law that can be drawn from."""
    return effects.on <= {"gate", "crosstalk"} or effects.has_law
