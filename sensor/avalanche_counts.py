"""Counts of a frame and their mean and variance, by the cheapest exact way.

    dead time alone                       its own law (`dead_time`)
    gate alone                            Poisson, in the time the gate is open
    afterpulsing alone, exponential       moments in closed form (`afterpulsing`), counts simulated
    crosstalk alone                       Poisson, then generation after generation (`crosstalk`)
    anything else                         simulated avalanche by avalanche (`avalanches`)

Where no closed form is known, mean and variance of a pixel are simulated once at fixed rates, 8 to
the decade and from fixed streams, and interpolated between; they are then good to about 0.5 %, and
do not depend on what else is asked for. Crosstalk together with dead time or afterpulsing enters
them as light from the mean counts of the neighbors, which leaves out that such light comes at the
time of an event.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from megalopta.sensor import afterpulsing, crosstalk, dead_time
from megalopta.sensor.avalanches import AvalancheEffects, simulate_counts
from megalopta.sensor.crosstalk import Crosstalk
from megalopta.sensor.dead_time import check_arrivals
from megalopta.sensor.gating import open_fraction
from megalopta.sensor.randomness import generator

_NODES_PER_DECADE = 8
_ARRIVALS_PER_NODE = 2e6
_FEWEST_ARRIVALS = 0.03
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
        open_hz = _open_rate(rate_hz, exposure_s, effects)
        primaries = dead_time.draw_counts(rng, open_hz, exposure_s, effects.dead_time)
        return crosstalk.spread(rng, primaries, effects.crosstalk)
    check_arrivals(rate_hz, exposure_s)
    return simulate_counts(rng, rate_hz, exposure_s, effects)


def count_moments(
    rate_hz: Floats, exposure_s: float, effects: AvalancheEffects
) -> tuple[Floats, Floats]:
    """Mean and variance of the counts of one exposure; as `draw_counts`."""
    if not effects.crosstalk.is_on:
        return _pixel_moments(rate_hz, exposure_s, effects)
    if _is_simple(effects):
        primaries = _open_rate(rate_hz, exposure_s, effects) * exposure_s
        return (
            crosstalk.mean(primaries, effects.crosstalk),
            crosstalk.variance(primaries, effects.crosstalk),
        )
    return _moments_with_light_of_neighbors(rate_hz, exposure_s, effects)


def _is_simple(effects: AvalancheEffects) -> bool:
    """Whether the counts of a pixel have a law that can be drawn from."""
    if effects.afterpulsing.is_on:
        return False
    is_coupled = effects.gate.is_on or effects.crosstalk.is_on
    return effects.dead_time.kind == "ideal" or not is_coupled


def _open_rate(rate_hz: Floats, exposure_s: float, effects: AvalancheEffects) -> Floats:
    return rate_hz * open_fraction(effects.gate, exposure_s) if effects.gate.is_on else rate_hz


def _pixel_moments(
    rate_hz: Floats, exposure_s: float, effects: AvalancheEffects
) -> tuple[Floats, Floats]:
    if _is_simple(effects):
        open_hz = _open_rate(rate_hz, exposure_s, effects)
        return dead_time.moments(open_hz, exposure_s, effects.dead_time)
    check_arrivals(rate_hz, exposure_s)
    only_afterpulsing = effects.dead_time.kind == "ideal" and not effects.gate.is_on
    if only_afterpulsing and not effects.afterpulsing.table_delays_s:
        is_stationary = effects.dead_time.start == "stationary"
        return afterpulsing.moments(rate_hz, exposure_s, effects.afterpulsing, is_stationary)
    return _interpolated_moments(rate_hz, exposure_s, effects)


def _moments_with_light_of_neighbors(
    rate_hz: Floats, exposure_s: float, effects: AvalancheEffects
) -> tuple[Floats, Floats]:
    alone = effects._replace(crosstalk=Crosstalk())
    open_s = exposure_s * open_fraction(effects.gate, exposure_s)
    rate = rate_hz
    mean, variance = _pixel_moments(rate, exposure_s, alone)
    for _ in range(_ROUNDS_OF_CROSSTALK):
        light = crosstalk.fired_mean(mean, effects.crosstalk) / open_s
        before, rate = rate, rate_hz + light
        mean, variance = _pixel_moments(rate, exposure_s, alone)
        if np.allclose(rate, before, rtol=1e-9):
            break
    return mean, variance


def _interpolated_moments(
    rate_hz: Floats, exposure_s: float, effects: AvalancheEffects
) -> tuple[Floats, Floats]:
    """Cubic through the four nearest nodes of the mean and variance per arrival."""
    arrivals = rate_hz * exposure_s
    place = np.log10(np.maximum(arrivals, _FEWEST_ARRIVALS)) * _NODES_PER_DECADE
    first = np.floor(place).astype(np.int64) - 1
    u = place - first
    weights = (
        -(u - 1) * (u - 2) * (u - 3) / 6,
        u * (u - 2) * (u - 3) / 2,
        -u * (u - 1) * (u - 3) / 2,
        u * (u - 1) * (u - 2) / 6,
    )
    nodes = np.arange(first.min(), first.max() + 4) if first.size else np.arange(4)
    is_needed = np.isin(nodes, first[..., None] + np.arange(4))
    table = np.zeros((nodes.size, 2))
    for row in np.flatnonzero(is_needed):
        table[row] = _node(int(nodes[row]), exposure_s, effects)
    per_arrival = sum(
        weight[..., None] * table[first - nodes[0] + k] for k, weight in enumerate(weights)
    )
    mean, variance = np.moveaxis(np.asarray(per_arrival), -1, 0) * arrivals
    return mean, variance


@lru_cache(maxsize=4096)
def _node(node: int, exposure_s: float, effects: AvalancheEffects) -> tuple[float, float]:
    arrivals = 10 ** (node / _NODES_PER_DECADE)
    exposures = max(int(_ARRIVALS_PER_NODE / max(arrivals, 1)), 16)
    rate = np.full((exposures, 1), arrivals / exposure_s)
    counts = simulate_counts(generator(0, "moments", node), rate, exposure_s, effects)
    return float(counts.mean() / arrivals), float(counts.var() / arrivals)
