"""Mean and variance of the counts of one pixel, crosstalk apart.

    dead time alone                       exact (`dead_time`)
    gate alone                            Poisson, in the time the gate is open
    gate, paralyzable dead time           exact (`gated_paralyzable`)
    afterpulsing alone, exponential       exact (`afterpulsing`)
    anything else                         simulated, interpolated (`tables`)

What is interpolated is the ratio to the moments of dead time and gate alone, which varies little,
by a cubic in the logarithm of the rate. The tables' errors are those of the moments.

Where pixels differ (`AvalancheMaps`), dead time alone has its own law in each. The other laws and
the ratios are evaluated at some factors between the least and the largest, and a polynomial is laid
through them.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.sensor.avalanches.tables import NODES_PER_DECADE, moment_ratios
from megalopta.sensor.effects import afterpulsing, dead_time, gated_paralyzable
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.effects.dead_time import check_arrivals
from megalopta.sensor.effects.fields import AvalancheEffects
from megalopta.sensor.effects.gating import open_fraction

_FEWEST_ARRIVALS = 0.03
_FACTORS_OF_A_LAW, _FACTORS_OF_A_TABLE = 9, 3


Moments = tuple[Floats, Floats]


def pixel_moments(
    rate_hz: Floats,
    exposure_s: float,
    effects: AvalancheEffects,
    maps: AvalancheMaps | None = None,
) -> Moments:
    """Mean and variance of the counts of one exposure, crosstalk apart.

    Parameters
    ----------
    rate_hz : array of any shape
        Rate of arrivals while the gate is open.
    exposure_s : float
    effects : AvalancheEffects
    maps : AvalancheMaps, optional
        How pixels differ, of the same shape; by default not at all.
    """
    dead, traps, on = effects.dead_time, effects.afterpulsing, effects.on - {"crosstalk"}
    is_law = on == {"afterpulsing"} and not traps.table_delays_s
    if on <= {"dead_time"} and dead.has_law:
        scale = 1.0 if maps is None else maps.dead_time
        return dead_time.moments(rate_hz, exposure_s, dead, scale)
    check_arrivals(rate_hz, exposure_s)
    if is_law:
        return _over_factors(
            lambda each: afterpulsing.moments(
                rate_hz, exposure_s, each.afterpulsing, dead.start == "stationary"
            ),
            effects,
            maps,
            _FACTORS_OF_A_LAW,
        )
    if on <= {"dead_time", "gate"} and dead.has_law and (len(on) < 2 or dead.kind == "paralyzable"):
        return _without_carriers(rate_hz, exposure_s, effects, maps)
    return _interpolated_moments(rate_hz, exposure_s, effects, maps)


def open_rate(rate_hz: Floats, exposure_s: float, effects: AvalancheEffects) -> Floats:
    """Rate of a pixel without gate that has as many arrivals, Hz."""
    return rate_hz * open_fraction(effects.gate, exposure_s) if effects.gate.is_on else rate_hz


def moments_without_carriers(
    rate_hz: Floats, exposure_s: float, effects: AvalancheEffects, scale: Floats | float = 1.0
) -> Moments:
    """Moments of dead time and gate alone.

    Exact, but where a gate meets a non-paralyzable dead time, or that ends other than at once.
    """
    dead, gate = effects.dead_time, effects.gate
    if gate.is_on and dead.kind == "paralyzable":
        return gated_paralyzable.moments(
            rate_hz, exposure_s, dead.dead_time_s, gate.window, dead.start == "stationary"
        )
    return dead_time.moments(open_rate(rate_hz, exposure_s, effects), exposure_s, dead, scale)


def _without_carriers(
    rate_hz: Floats, exposure_s: float, effects: AvalancheEffects, maps: AvalancheMaps | None
) -> Moments:
    if maps is not None and effects.gate.is_on and effects.dead_time.kind == "paralyzable":
        return _over_factors(
            lambda each: moments_without_carriers(rate_hz, exposure_s, each),
            effects,
            maps,
            _FACTORS_OF_A_LAW,
        )
    scale = 1.0 if maps is None else maps.dead_time
    return moments_without_carriers(rate_hz, exposure_s, effects, scale)


def _interpolated_moments(
    rate_hz: Floats, exposure_s: float, effects: AvalancheEffects, maps: AvalancheMaps | None
) -> Moments:
    """Moments without carriers times a cubic through the ratios at the four nearest nodes."""
    place = np.log10(np.maximum(rate_hz * exposure_s, _FEWEST_ARRIVALS)) * NODES_PER_DECADE
    first = np.floor(place).astype(np.int64) - 1
    u = place - first
    weights = (
        -(u - 1) * (u - 2) * (u - 3) / 6,
        u * (u - 2) * (u - 3) / 2,
        -u * (u - 1) * (u - 3) / 2,
        u * (u - 1) * (u - 2) / 6,
    )
    start = int(first.min(initial=0))
    nodes = np.unique(np.unique(first)[:, None] + np.arange(4))
    table = np.zeros((int(first.max(initial=0)) + 4 - start, 2))

    def ratios(each: AvalancheEffects) -> Moments:
        table[nodes - start] = moment_ratios(
            nodes, exposure_s, each, lambda rate: moments_without_carriers(rate, exposure_s, each)
        )
        both = sum(weight[..., None] * table[first - start + k] for k, weight in enumerate(weights))
        return np.asarray(both)[..., 0], np.asarray(both)[..., 1]

    mean, variance = _without_carriers(rate_hz, exposure_s, effects, maps)
    ratio_of_means, ratio_of_variances = _over_factors(ratios, effects, maps, _FACTORS_OF_A_TABLE)
    return mean * ratio_of_means, variance * ratio_of_variances


def _over_factors(
    law: Callable[[AvalancheEffects], Moments],
    effects: AvalancheEffects,
    maps: AvalancheMaps | None,
    count: int,
) -> Moments:
    """Evaluate a law where every pixel has its own dead time and number of carriers."""
    if maps is None:
        return law(effects)
    mean, variance = np.zeros_like(maps.dead_time), np.zeros_like(maps.dead_time)
    for dead_factor, of_dead in _nodes(maps.dead_time, count * effects.dead_time.is_on):
        for factor, of_traps in _nodes(maps.afterpulsing, count * effects.afterpulsing.is_on):
            each = effects.model_copy(
                update={
                    "dead_time": _scaled(effects.dead_time, "dead_time_s", dead_factor),
                    "afterpulsing": _scaled(effects.afterpulsing, "mean_carriers", factor),
                }
            )
            for total, part in zip((mean, variance), law(each), strict=True):
                total += of_dead * of_traps * part
    return mean, variance


def _scaled(effect: Any, field: str, factor: float) -> Any:
    return effect.model_copy(update={field: getattr(effect, field) * factor})


def _nodes(factors: Floats, count: int) -> list[tuple[float, Floats]]:
    """Factors of a polynomial, and what every pixel takes of the value at each (Lagrange)."""
    low, high = float(factors.min(initial=np.inf)), float(factors.max(initial=0))
    if count == 0 or not factors.size:
        return [(1.0, np.ones_like(factors))]
    if high - low <= 1e-9 * high:
        return [(high, np.ones_like(factors))]
    nodes = low + (high - low) * (1 - np.cos(np.pi * np.arange(count) / (count - 1))) / 2
    return [
        (
            float(node),
            np.prod([(factors - other) / (node - other) for other in nodes if other != node], 0),
        )
        for node in nodes
    ]
