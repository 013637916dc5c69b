"""Counts of a frame with their mean and variance, by the cheapest exact method.

    dead time alone                       closed form (`dead_time`)
    gate alone                            Poisson, in the time the gate is open
    crosstalk alone                       Poisson, then generation after generation (`crosstalk`)
    anything else                         simulated avalanche by avalanche (`simulation`)

Mean and variance come from `moments`, with crosstalk from `coupled`.
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
        Rate of detectable photons plus dark counts; constant, or in S equal parts of the exposure.
    exposure_s : float
    effects : AvalancheEffects
    maps : AvalancheMaps, optional
        Differences between pixels; default: none.
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

    For rates in parts, the moments of each part's rate are weighted with its share of the open
    time. This is exact without dead time and afterpulsing; otherwise it neglects what a part
    inherits from the one before. With dead time alone, two pixels with the same arrivals differ by
    at most one count from any moment on, and by none if both are live then. So the error of the
    mean at each of the S − 1 borders, and at the start, is at most the share of time that a part is
    dead. With afterpulses each of these counts becomes 1/(1 − p) counts, plus the carriers trapped
    at a border.
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
    """Mean of rates in parts (S, rows, columns) over the open time, Hz."""
    weights = part_weights(effects.gate, exposure_s, len(rate_hz))
    return np.asarray(np.tensordot(weights, rate_hz, 1))


def _strength(maps: AvalancheMaps | None) -> Floats | None:
    return None if maps is None else maps.crosstalk


def _is_simple(effects: AvalancheEffects) -> bool:
    """True if the counts of a pixel follow a distribution that can be drawn from directly."""
    return effects.on <= {"gate", "crosstalk"} or effects.has_law
