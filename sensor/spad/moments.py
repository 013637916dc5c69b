"""Mean and variance of the counts of one pixel, without crosstalk.

    dead time alone, gate alone    closed forms (`dead_time`)
    bright light                   as a renewal process (`bright_moments`)
    anything else                  computed without draws (`pixel_process`)

Of many rates, those of a few are computed: polynomials of degree 8 over the logarithm of the rate
connect them, each over a decade or, where every second of its values is not told by the others,
over half as much, and so on. In bright light the variance rises and falls with the number of dead
times that fit into the exposure, and such pieces are short.

Where pixels differ (`AvalancheMaps`), a polynomial over three, five, nine or seventeen factors from
the smallest to the largest interpolates the ratios to the moments of dead time, until it agrees
with the one before.

The mean is within `MEAN_ERROR`, the variance within `VARIANCE_ERROR` or `VARIANCE_FLOOR`.

**Bright light**, in which few waits for an arrival matter:

    paralyzable        dead for good after the first arrival, so dead time alone tells the counts
    non-paralyzable    gaps of the dead time and a wait, far shorter: the waits of n gaps together
                       follow a gamma distribution, and many gaps are a normal number
    with a gate        closed for a dead time or more: every window starts live, and its counts
                       are those of dead time alone in an exposure as long

After a dead time τ, p carriers released after a delay d shorten the next wait as more arrivals
would, (p/τ)·x/(eˣ − 1) per second with x = τ/d. Neglected is (p/rτ)², and that their number
changes: 2·p/(rτ)² of the variance.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import product
from threading import Lock
from typing import Any

import numpy as np
from scipy.integrate import simpson
from scipy.interpolate import BarycentricInterpolator
from scipy.special import gammainc

from megalopta.core.arrays import Floats, Mask
from megalopta.core.errors import UserError
from megalopta.sensor.effects import dead_time
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.effects.dead_time import check_arrivals
from megalopta.sensor.effects.gating import open_fraction, open_time
from megalopta.sensor.spad.model import AvalancheEffects
from megalopta.sensor.spad.pixel_process import counts_of_pixel

_BRIGHT, _PER_ROOT_CARRIER, _PER_CARRIER, _MANY_COUNTS = 10.0, 25.0, 200.0, 500.0
"""Least arrivals per dead time, more with carriers or with a gate or table besides, and least
counts: errors of the variance below 1 %."""
_NEVER = 1e-5
"""Counts of a paralyzable pixel after its first that are neglected."""
_EVEN = 0.7
"""Variance from which the moments of a rounded number are even, to 3e-5."""

Moments = tuple[Floats, Floats]


def is_limit(
    rate_hz: Floats, exposure_s: float, effects: AvalancheEffects, maps: AvalancheMaps | None
) -> Mask:
    """True for pixels whose moments `bright_moments` states; parameters as `pixel_moments`."""
    dead, gate, traps = effects.dead_time, effects.gate, effects.afterpulsing
    dead_s = dead.dead_time_s * (np.ones(()) if maps is None else maps.dead_time)
    carriers = traps.mean_carriers * (np.ones(()) if maps is None else maps.afterpulsing)
    per_dead_time = rate_hz * dead_s
    least = _PER_ROOT_CARRIER * np.sqrt(carriers)
    if gate.is_on or traps.table_delays_s:
        least = _PER_CARRIER * carriers
    is_bright = per_dead_time >= np.maximum(_BRIGHT, least)
    if not dead.is_on:
        return np.zeros(rate_hz.shape, np.bool_)
    if gate.is_on:
        period_s, width_s, _ = gate.window
        closed = (period_s - width_s >= dead_s) & (_windows(exposure_s, effects)[0] >= 0)
        is_alone = dead.has_law and (traps.mean_carriers == 0)
        never = dead.has_law & (dead.kind == "nonparalyzable") & is_bright
        return np.asarray(closed & (is_alone | never))
    if dead.kind == "paralyzable":
        return np.asarray(rate_hz * exposure_s * np.exp(-per_dead_time) < _NEVER)
    return np.asarray(is_bright & (exposure_s > _MANY_COUNTS * dead_s))


def bright_moments(
    rate_hz: Floats, exposure_s: float, effects: AvalancheEffects, maps: AvalancheMaps | None
) -> Moments:
    """Mean and variance of counts where `is_limit`."""
    scale = 1.0 if maps is None else maps.dead_time
    dead = effects.dead_time
    dead_s = dead.dead_time_s * scale
    traps = effects.afterpulsing
    if traps.is_on and dead.kind == "nonparalyzable":
        carriers = traps.mean_carriers * (1.0 if maps is None else maps.afterpulsing)
        x = dead_s / (traps.table_delays_s[-1] if traps.table_delays_s else traps.delay_s)
        rate_hz = rate_hz + carriers / dead_s * x / np.expm1(np.minimum(x, 500.0))
    if effects.gate.is_on:
        whole, *cut_s = _windows(exposure_s, effects)
        live = dead.model_copy(update={"start": "live"})
        mean, variance = (
            whole * part for part in dead_time.moments(rate_hz, effects.gate.window[1], live, scale)
        )
        for length_s in cut_s:
            if length_s > 1e-9 * effects.gate.window[1]:
                more = dead_time.moments(rate_hz, length_s, live, scale)
                mean, variance = mean + more[0], variance + more[1]
        return mean, np.maximum(variance, 0.0)
    if dead.kind == "paralyzable":
        return dead_time.moments(rate_hz, exposure_s, dead, scale)
    wait_s, square_s2 = 1 / rate_hz, 2 / rate_hz**2
    if dead.twilight_s:
        waits = np.exp(-rate_hz * dead.twilight_s)
        wait_s, square_s2 = waits * wait_s, waits * square_s2
    elif dead.recharge_s:
        # wait (s) of a pixel that recharges
        arrivals = (rate_hz * dead.recharge_s)[..., None]
        times = (np.sqrt(80 / arrivals) + 40 / arrivals) * np.linspace(0, 1, 129)
        waiting = np.exp(-arrivals * (times + np.expm1(-times)))
        mean_wait, half_square = simpson(waiting, x=times), simpson(times * waiting, x=times)
        wait_s, square_s2 = dead.recharge_s * mean_wait, 2 * dead.recharge_s**2 * half_square
    first_s, gap_s, variance_s2 = 1 / rate_hz, dead_s + wait_s, square_s2 - wait_s**2
    per_gap = variance_s2 / gap_s**2
    variance = per_gap * exposure_s / gap_s
    if dead.start == "stationary":  # the first gap has begun anywhere
        mean = exposure_s / gap_s
        k = np.arange(1, 33)[:, None]
        waves = np.cos(2 * np.pi * k * mean.ravel()) / (np.pi * k) ** 2
        rounded = 1 / 6 - (waves * np.exp(-2 * (np.pi * k) ** 2 * variance.ravel())).sum(axis=0)
        return mean, variance + rounded.reshape(mean.shape)
    mean, variance = (exposure_s - first_s) / gap_s + (1 + per_gap) / 2, variance + 1 / 12
    few = variance < _EVEN
    dead_s, first_s, wait_s, variance_s2 = (
        np.broadcast_to(part, few.shape)[few] for part in (dead_s, first_s, wait_s, variance_s2)
    )
    least = np.maximum(np.floor(mean[few]) - 7, 0)
    number = least + np.arange(16)[:, None]
    # chance of more than each number of counts: so many dead times and waits before the end
    waits_s, spread_s2 = first_s + number * wait_s, first_s**2 + number * variance_s2
    left_s = np.maximum(exposure_s - number * dead_s, 0.0)
    chances = gammainc(waits_s**2 / spread_s2, left_s * waits_s / spread_s2)
    above = chances.sum(axis=0)
    square = ((2 * (number - least) + 1) * chances).sum(axis=0)
    mean[few], variance[few] = least + above, np.maximum(square - above**2, 0.0)
    return mean, variance


def _windows(exposure_s: float, effects: AvalancheEffects) -> tuple[float, float, float]:
    """Number of whole windows in an exposure, and open time before and after these, s.

    The number is −1 if a window is open at the start of an exposure that does not start live.
    """
    period_s, width_s, phase_s = effects.gate.window
    first = np.ceil((0 - phase_s) / period_s)
    starts_s = phase_s + first * period_s
    gate = effects.gate.window
    before_s = open_time(min(starts_s, exposure_s), *gate) - open_time(0.0, *gate)
    after = max(exposure_s - starts_s, 0.0) / period_s
    whole = np.floor(after)
    left_s = (after - whole) * period_s
    if left_s >= width_s:
        whole, left_s = whole + 1, 0.0
    if before_s > 1e-12 * width_s and effects.dead_time.start != "live":
        whole = -1.0
    return float(whole), float(before_s), float(left_s)


MEAN_ERROR, VARIANCE_ERROR, VARIANCE_FLOOR = 1e-3, 1e-2, 0.02
"""Errors of mean and variance, relative, and of the variance in counts squared."""

_FEW_RATES = 8
_FEWEST_ARRIVALS, _NO_COUNTS = 1e-4, 1e-7
_NODES = (1 - np.cos(np.pi * np.arange(9) / 8)) / 2
_MOST_WORK = 1e9
"""Operations for all rates of a frame, about 20 s."""
_FACTORS, _MOST_OFF = (3, 5, 9, 17), 0.01
_one_at_a_time = Lock()


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
            found = BarycentricInterpolator(nodes, of_nodes, rng=0)(place[some])
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
    told = BarycentricInterpolator(_NODES[::2], values[::2], rng=0)(_NODES[1::2])
    off_mean, off_variance = np.abs(told - values[1::2]).T
    allowed = np.maximum(0.02 * variance, 0.02)[1::2] / mean[1::2]
    is_told = np.all(off_mean < 2e-3) and np.all(off_variance < allowed)
    return values if is_told else None, work.sum()
