"""Mean and variance of the counts of one pixel, without crosstalk.

    dead time alone, gate alone    closed forms (`dead_time`)
    bright light                   as a renewal process (`bright_limit`)
    anything else                  computed without draws (`pixel_process`)

Of many rates, those of a few are computed: polynomials of degree 8 over the logarithm of the rate
connect them, each over a decade or, where every second of its values is not told by the others,
over half as much, and so on. In bright light the variance rises and falls with the number of dead
times that fit into the exposure, and such pieces are short.

Where pixels differ (`AvalancheMaps`), a polynomial over three, five, nine or seventeen factors from
the smallest to the largest interpolates the ratios to the moments of dead time, until it agrees
with the one before.

The mean is within `MEAN_ERROR`, the variance within `VARIANCE_ERROR` or `VARIANCE_FLOOR`.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import product
from threading import Lock
from typing import Any

import numpy as np
from scipy.interpolate import BarycentricInterpolator

from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.sensor.effects import dead_time
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.effects.dead_time import check_arrivals
from megalopta.sensor.effects.gating import open_fraction
from megalopta.sensor.spad.bright_limit import bright_moments, is_limit
from megalopta.sensor.spad.model import AvalancheEffects
from megalopta.sensor.spad.pixel_process import counts_of_pixel

MEAN_ERROR, VARIANCE_ERROR, VARIANCE_FLOOR = 1e-3, 1e-2, 0.02
"""Errors of mean and variance, relative, and of the variance in counts squared."""

_FEW_RATES = 8
_FEWEST_ARRIVALS, _NO_COUNTS = 1e-4, 1e-7
_NODES = (1 - np.cos(np.pi * np.arange(9) / 8)) / 2
_MOST_WORK = 1e9
"""Operations for all rates of a frame, about 20 s."""
_FACTORS, _MOST_OFF = (3, 5, 9, 17), 0.01
_one_at_a_time = Lock()

Moments = tuple[Floats, Floats]


def pixel_moments(
    rate_hz: Floats,
    exposure_s: float,
    effects: AvalancheEffects,
    maps: AvalancheMaps | None = None,
) -> Moments:
    """Return mean and variance of the counts of one exposure, without crosstalk.

    Raises UserError where they are not stated.

    Parameters
    ----------
    rate_hz : array of any shape
        Rate of arrivals while the gate is open.
    maps : AvalancheMaps, optional
        Differences between pixels, of the same shape; default: none.
    """
    check_arrivals(rate_hz, exposure_s)
    on = effects.on - {"crosstalk"}
    is_closed_form = len(on) < 2 and on <= {"dead_time", "gate"} and effects.dead_time.has_law
    alone, chosen = effects.without_crosstalk, np.zeros(np.shape(rate_hz), np.bool_)
    if not is_closed_form:
        chosen = is_limit(rate_hz, exposure_s, alone, maps)
    if chosen.any():
        moments = np.zeros((2, *rate_hz.shape))
        for some, moments_of in ((chosen, bright_moments), (~chosen, pixel_moments)):
            own = None if maps is None else AvalancheMaps(*(factor[some] for factor in maps))
            moments[:, some] = moments_of(rate_hz[some], exposure_s, alone, own)
        return moments[0], moments[1]
    if not is_closed_form and maps is None:
        return _at_rates(rate_hz, exposure_s, alone)
    open_hz = open_rate(rate_hz, exposure_s, effects)
    scale = 1.0 if maps is None else maps.dead_time
    mean, variance = dead_time.moments(open_hz, exposure_s, effects.dead_time, scale)
    if is_closed_form:
        return mean, variance

    def ratios(of_pixel: AvalancheEffects, share: float) -> Floats:
        moments = np.array(_at_rates(rate_hz, exposure_s, of_pixel, share))
        alone = np.array(dead_time.moments(open_hz, exposure_s, of_pixel.dead_time))
        # a variance that hardly exists is not told to a part of itself
        is_told = alone > alone[0] * np.array([0.0, 1e-3]).reshape(2, *[1] * rate_hz.ndim)
        return np.divide(moments, alone, np.ones_like(moments), where=is_told)

    assert maps is not None
    of_mean, of_variance = _over_factors(ratios, alone, maps)
    return mean * of_mean, variance * of_variance


def open_rate(rate_hz: Floats, exposure_s: float, effects: AvalancheEffects) -> Floats:
    """Rate of a pixel without a gate that has the same number of arrivals, Hz."""
    return rate_hz * open_fraction(effects.gate, exposure_s) if effects.gate.is_on else rate_hz


def _over_factors(
    ratios: Callable[[AvalancheEffects, float], Floats],
    effects: AvalancheEffects,
    maps: AvalancheMaps,
) -> Floats:
    """Ratios (2, ...) for pixels with their own dead time and number of carriers."""
    coarse = None
    for nodes in _FACTORS:
        fine = np.zeros((2, *maps.dead_time.shape))
        pairs = list(
            product(
                _factors(maps.dead_time, effects.dead_time.is_on, nodes),
                _factors(maps.afterpulsing, effects.afterpulsing.is_on, nodes),
            )
        )
        for (dead_factor, of_dead), (factor, of_traps) in pairs:
            scaled = effects.model_copy(
                update={
                    "dead_time": _scaled(effects.dead_time, "dead_time_s", dead_factor),
                    "afterpulsing": _scaled(effects.afterpulsing, "mean_carriers", factor),
                }
            )
            fine += of_dead * of_traps * ratios(scaled, 1 / len(pairs))
        if coarse is not None and all(
            np.all(np.abs(fine[row] - coarse[row]) <= most * np.abs(fine[row]))
            for row, most in enumerate((_MOST_OFF, 5 * _MOST_OFF))
        ):
            return fine
        coarse = fine
    raise UserError(
        "mismatch_sigma: in so bright light, mean and variance are not stated for pixels that "
        "differ in dead time or carriers; lower the light, or ask for no expectation"
    )


def _scaled(effect: Any, field: str, factor: float) -> Any:
    return effect.model_copy(update={field: getattr(effect, field) * factor})


def _factors(factors: Floats, is_on: bool, number: int) -> list[tuple[float, Floats]]:
    """Nodes over a factor, and each pixel's weight of each in a polynomial (Lagrange)."""
    low, high = float(factors.min(initial=np.inf)), float(factors.max(initial=0))
    if not is_on or not factors.size or high - low <= 1e-9 * high:
        return [(high if is_on and factors.size else 1.0, np.ones_like(factors))]
    places = (1 - np.cos(np.pi * np.arange(number) / (number - 1))) / 2
    nodes = (low + (high - low) * places).tolist()
    return list(zip(nodes, lagrange(factors, nodes), strict=True))


def lagrange(x: Floats, nodes: Sequence[float]) -> list[Floats]:
    """Return the weight of each node in a polynomial through the values at all of them."""
    return [
        np.prod([(x - other) / (node - other) for other in nodes if other != node], axis=0)
        for node in nodes
    ]


def _at_rates(
    rate_hz: Floats, exposure_s: float, effects: AvalancheEffects, share: float = 1.0
) -> Moments:
    """Mean and variance at rates of any shape, one by one or from polynomials over the rate."""
    rates, place = np.unique(rate_hz, return_inverse=True)
    # one thread computes: others would repeat its work
    with _one_at_a_time:
        if rates.size <= _FEW_RATES:
            found = [_of_pixel(rate, exposure_s, effects)[:2] for rate in rates.tolist()]
            moments = np.array(found).reshape(-1, 2)
        else:
            arrivals = np.maximum(rates * exposure_s, _FEWEST_ARRIVALS)
            moments = _in_pieces(np.log10(arrivals), exposure_s, effects, share)
            moments *= (rates * exposure_s / arrivals)[:, None]
    mean, variance = moments[place.ravel()].T.reshape(2, *np.shape(rate_hz))
    return mean, variance


def _in_pieces(place: Floats, exposure_s: float, effects: AvalancheEffects, share: float) -> Floats:
    """Mean and variance (N, 2) at logarithms of arrivals, for a share of the longest time."""
    moments, total = np.empty((place.size, 2)), 0.0
    pieces = [(1.0, place // 1.0, np.arange(place.size))]
    while pieces:
        width, numbers, chosen = pieces.pop()
        for number in np.unique(numbers):
            some = chosen[numbers == number]
            nodes = width * (number + _NODES)
            of_nodes, work = _piece(width, float(number), exposure_s, effects)
            total += work
            if total > share * _MOST_WORK:
                raise UserError(
                    f"mean and variance at up to {10 ** place[-1] / exposure_s:.3g} detections and "
                    "dark counts per second take too long to compute with these effects; lower the "
                    "light or exposure_s, or ask for no expectation"
                )
            if of_nodes is None:
                pieces.append((width / 2, place[some] // (width / 2), some))
                continue
            found = BarycentricInterpolator(nodes, of_nodes)(place[some])
            mean = np.exp(found[:, 0])
            moments[some] = np.column_stack([mean - _NO_COUNTS, found[:, 1] * mean])
    return np.maximum(moments, 0.0)


def _of_pixel(
    rate_hz: float, exposure_s: float, effects: AvalancheEffects
) -> tuple[float, float, float]:
    """Mean and variance at one rate, and operations taken."""
    rate = np.array([rate_hz])
    if is_limit(rate, exposure_s, effects, None)[0]:
        mean, variance = bright_moments(rate, exposure_s, effects, None)
        return float(mean[0]), float(variance[0]), 1.0
    return counts_of_pixel(rate_hz, exposure_s, effects)


@lru_cache(maxsize=4096)
def _piece(
    width: float, number: float, exposure_s: float, effects: AvalancheEffects
) -> tuple[Floats | None, float]:
    """Logarithm of the mean, and variance over mean, at the nodes (9, 2); operations taken.

    None if a polynomial through every second does not tell the others.
    """
    arrivals = 10 ** (width * (number + _NODES))
    mean, variance, work = np.array(
        [_of_pixel(each / exposure_s, exposure_s, effects) for each in arrivals]
    ).T
    mean += _NO_COUNTS
    values = np.column_stack([np.log(mean), variance / mean])
    told = BarycentricInterpolator(_NODES[::2], values[::2])(_NODES[1::2])
    off_mean, off_variance = np.abs(told - values[1::2]).T
    allowed = np.maximum(0.02 * variance, 0.02)[1::2] / mean[1::2]
    is_told = np.all(off_mean < 2e-3) and np.all(off_variance < allowed)
    return values if is_told else None, work.sum()
