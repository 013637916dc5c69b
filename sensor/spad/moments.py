"""Mean and variance of the counts of a frame, without drawing any.

    dead time alone, gate alone    closed forms (`dead_time`)
    crosstalk alone                closed form (`crosstalk`)
    crosstalk and others           from those of single pixels (`coupled`)
    bright light                   as a renewal process (`bright_moments`)
    anything else                  computed step by step (`pixel_process`)

**Many rates**: polynomials of degree 8 over the logarithm of the rate connect those of a few, each
over a decade, or over half as much and so on, where every second of its values does not follow from
the others. In bright light the variance rises and falls with the number of dead times that fit into
the exposure, and such pieces are short.

**Pixels that differ** (`AvalancheMaps`): a polynomial over three, five, nine or seventeen factors
from the smallest to the largest interpolates the ratios to the moments of dead time, until it
agrees with the one before.

The mean is within `MEAN_ERROR`, the variance within `VARIANCE_ERROR` or `VARIANCE_FLOOR`.

**Bright light**, in which few waits for an arrival matter:

    paralyzable        dead for good after the first arrival, so counts are those of dead time alone
    non-paralyzable    gaps of the dead time and a wait, far shorter: the waits of n gaps together
                       follow a gamma distribution, and many gaps are a normal number
    with a gate        closed for a dead time or more: every window starts live, and its counts
                       are those of dead time alone in an exposure as long

After a dead time τ, p carriers released after a delay d shorten the next wait as more arrivals
would, (p/τ)·x/(eˣ − 1) per second with x = τ/d. Neglected is (p/rτ)², and that their number
changes: 2·p/(rτ)² of the variance.
"""

from collections.abc import Callable
from functools import lru_cache
from itertools import product
from threading import Lock

import numpy as np
from scipy.integrate import simpson
from scipy.interpolate import BarycentricInterpolator
from scipy.special import gammainc

from megalopta.core.arrays import Floats, Mask
from megalopta.core.compiling import compiled
from megalopta.core.errors import UserError
from megalopta.sensor.effects import crosstalk, dead_time, gating
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.spad.coupled import coupled_moments
from megalopta.sensor.spad.model import AvalancheEffects
from megalopta.sensor.spad.pixel_process import counts_of_pixel

MEAN_ERROR, VARIANCE_ERROR, VARIANCE_FLOOR = 1e-3, 1e-2, 0.02
"""Errors of mean and variance, relative, and of the variance in counts squared."""

_BRIGHT, _PER_ROOT_CARRIER, _PER_CARRIER, _MANY_COUNTS = 10.0, 25.0, 200.0, 500.0
"""Least arrivals per dead time, more with carriers or with a gate or table besides, and least
counts: errors of the variance below 1 %."""
_FEWEST_ARRIVALS, _NO_COUNTS = 1e-4, 1e-7
_NODES = (1 - np.cos(np.pi * np.arange(9) / 8)) / 2
_FACTORS, _MOST_OFF = (3, 5, 9, 17), 0.01
_one_at_a_time = Lock()

Moments = tuple[Floats, Floats]


def count_moments(
    rate_hz: Floats, exposure_s: float, effects: AvalancheEffects, maps: AvalancheMaps | None = None
) -> Moments:
    """Mean and variance (rows, columns) of the counts of one exposure; parameters as `draw_frame`.

    For rates in parts, the moments of each part's rate are weighted with its share of the open
    time. This is exact without dead time and afterpulsing; otherwise it neglects what a part
    inherits from the one before. With dead time alone, two pixels with the same arrivals differ by
    at most one count from any moment on, and by none if both are live then. So the error of the
    mean at each of the S − 1 borders, and at the start, is at most the share of time that a part is
    dead. With afterpulses each of these counts becomes 1/(1 − p) counts, plus the carriers trapped
    at a border.
    """
    if rate_hz.ndim == 3 and effects.has_memory:
        weights = gating.part_weights(effects.gate, exposure_s, len(rate_hz))
        of_parts = [count_moments(part_hz, exposure_s, effects, maps) for part_hz in rate_hz]
        mean, variance = np.tensordot(weights, of_parts, 1)
        return mean, variance
    if rate_hz.ndim == 3:
        rate_hz = mean_rate(rate_hz, exposure_s, effects)
    if "crosstalk" not in effects.on:
        return pixel_moments(rate_hz, exposure_s, effects, maps)
    if effects.on <= {"gate", "crosstalk"}:
        primaries = open_rate(rate_hz, exposure_s, effects) * exposure_s
        strength = None if maps is None else maps.crosstalk
        return (
            crosstalk.mean(primaries, effects.crosstalk, strength),
            crosstalk.variance(primaries, effects.crosstalk, strength),
        )
    return coupled_moments(rate_hz, exposure_s, effects, maps, pixel_moments)


def pixel_moments(
    rate_hz: Floats, exposure_s: float, effects: AvalancheEffects, maps: AvalancheMaps | None = None
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
    dead_time.check_arrivals(rate_hz, exposure_s)
    open_hz = open_rate(rate_hz, exposure_s, effects)
    scale = 1.0 if maps is None else maps.dead_time
    if effects.on <= {"gate"} or effects.is_closed_form:
        return dead_time.moments(open_hz, exposure_s, effects.dead_time, scale)
    is_bright = is_limit(rate_hz, exposure_s, effects, maps)
    if is_bright.any():
        mean, variance = np.empty(rate_hz.shape), np.empty(rate_hz.shape)
        for pixels, moments_of in ((is_bright, bright_moments), (~is_bright, pixel_moments)):
            maps_of_pixels = maps and AvalancheMaps(*(factor[pixels] for factor in maps))
            mean[pixels], variance[pixels] = moments_of(
                rate_hz[pixels], exposure_s, effects, maps_of_pixels
            )
        return mean, variance
    if maps is None:
        return _at_rates(rate_hz, exposure_s, effects)
    mean, variance = dead_time.moments(open_hz, exposure_s, effects.dead_time, scale)

    def ratios(of_pixel: AvalancheEffects, share: float) -> Floats:
        """Moments over those of dead time alone, (2, ...)."""
        moments = np.array(_at_rates(rate_hz, exposure_s, of_pixel, share))
        alone = np.array(dead_time.moments(open_hz, exposure_s, of_pixel.dead_time))
        # the ratio to a variance that hardly exists is unknown
        is_known = alone > alone[0] * np.array([0.0, 1e-3]).reshape(2, *[1] * rate_hz.ndim)
        return np.divide(moments, alone, np.ones_like(moments), where=is_known)

    of_mean, of_variance = _over_factors(ratios, effects, maps)
    return mean * of_mean, variance * of_variance.clip(0)


def mean_rate(rate_hz: Floats, exposure_s: float, effects: AvalancheEffects) -> Floats:
    """Mean of rates in parts (S, rows, columns) over the open time, Hz."""
    weights = gating.part_weights(effects.gate, exposure_s, len(rate_hz))
    return np.asarray(np.tensordot(weights, rate_hz, 1))


def open_rate(rate_hz: Floats, exposure_s: float, effects: AvalancheEffects) -> Floats:
    """Rate of a pixel without a gate that has the same number of arrivals, Hz."""
    if "gate" not in effects.on:
        return rate_hz
    return rate_hz * gating.open_fraction(effects.gate, exposure_s)


def is_limit(
    rate_hz: Floats, exposure_s: float, effects: AvalancheEffects, maps: AvalancheMaps | None
) -> Mask:
    """True for pixels whose moments `bright_moments` states; parameters as `pixel_moments`."""
    dead, gate, traps = effects.dead_time, effects.gate, effects.afterpulsing
    if not dead.is_on:
        return np.zeros(rate_hz.shape, np.bool_)
    dead_s = dead.dead_time_s * (np.ones(()) if maps is None else maps.dead_time)
    carriers = traps.mean_carriers * (np.ones(()) if maps is None else maps.afterpulsing)
    per_dead_time = rate_hz * dead_s
    least = _PER_ROOT_CARRIER * np.sqrt(carriers)
    if gate.is_on or traps.table_delays_s:
        least = _PER_CARRIER * carriers
    is_bright = per_dead_time >= np.maximum(_BRIGHT, least)
    if gate.is_on:
        period_s, width_s, _ = gate.window
        is_closed = (period_s - width_s >= dead_s) & (_windows(exposure_s, effects)[0] >= 0)
        is_alone = dead.is_closed_form and (traps.mean_carriers == 0)
        never = dead.is_closed_form & (dead.kind == "nonparalyzable") & is_bright
        return np.asarray(is_closed & (is_alone | never))
    if dead.kind == "paralyzable":
        # fewer counts after its first are neglected
        return np.asarray(rate_hz * exposure_s * np.exp(-per_dead_time) < 1e-5)
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
        width_s, live = effects.gate.window[1], dead.model_copy(update={"start": "live"})
        windows, *cut_s = _windows(exposure_s, effects)
        moments = windows * np.array(dead_time.moments(rate_hz, width_s, live, scale))
        for length_s in cut_s:
            if length_s > 1e-9 * width_s:
                moments += dead_time.moments(rate_hz, length_s, live, scale)
        return moments[0], np.maximum(moments[1], 0.0)
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
    few = variance < 0.7  # else even, to 3e-5
    dead_s, first_s, wait_s, variance_s2 = (
        np.broadcast_to(value, few.shape)[few] for value in (dead_s, first_s, wait_s, variance_s2)
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
    """Whole windows in an exposure, −1 if it starts in one and not live; open s around them."""
    period_s, width_s, phase_s = window = effects.gate.window
    starts_s = phase_s + np.ceil((0 - phase_s) / period_s) * period_s
    before_s = gating.open_time(min(starts_s, exposure_s), *window)
    before_s -= gating.open_time(0.0, *window)
    after = max(exposure_s - starts_s, 0.0) / period_s
    windows = np.floor(after)
    left_s = (after - windows) * period_s
    if left_s >= width_s:
        windows, left_s = windows + 1, 0.0
    if before_s > 1e-12 * width_s and effects.dead_time.start != "live":
        windows = -1.0
    return float(windows), float(before_s), float(left_s)


def _over_factors(
    ratios: Callable[[AvalancheEffects, float], Floats],
    effects: AvalancheEffects,
    maps: AvalancheMaps,
) -> Floats:
    """Ratios (2, ...) for pixels with their own dead time and number of carriers."""
    coarse = None
    for number in _FACTORS:
        fine = np.zeros((2, *maps.dead_time.shape))
        pairs = list(
            product(
                _factors(maps.dead_time, effects.dead_time.is_on, number),
                _factors(maps.afterpulsing, effects.afterpulsing.is_on, number),
            )
        )
        for (dead_factor, dead_weight), (carriers_factor, carriers_weight) in pairs:
            dead_time_of_node = {"dead_time_s": effects.dead_time.dead_time_s * dead_factor}
            traps_of_node = {"mean_carriers": effects.afterpulsing.mean_carriers * carriers_factor}
            effects_of_node = effects.replaced(
                dead_time=effects.dead_time.model_copy(update=dead_time_of_node),
                afterpulsing=effects.afterpulsing.model_copy(update=traps_of_node),
            )
            fine += dead_weight * carriers_weight * ratios(effects_of_node, 1 / len(pairs))
        if coarse is not None:
            most_off = np.array([_MOST_OFF, 5 * _MOST_OFF]).reshape(2, *[1] * (fine.ndim - 1))
            if np.all(np.abs(fine - coarse) <= most_off * np.abs(fine)):
                return fine
        coarse = fine
    raise UserError(
        "mismatch_sigma: in so bright light, mean and variance are not stated for pixels that "
        "differ in dead time or carriers; lower the light, or ask for no expectation"
    )


def _factors(factors: Floats, is_on: bool, number: int) -> list[tuple[float, Floats]]:
    """Nodes over a factor, and each pixel's weight of each in a polynomial."""
    low, high = float(factors.min(initial=np.inf)), float(factors.max(initial=0))
    if not is_on or not factors.size or high - low <= 1e-9 * high:
        return [(high if is_on and factors.size else 1.0, np.ones_like(factors))]
    places = (1 - np.cos(np.pi * np.arange(number) / (number - 1))) / 2
    nodes = low + (high - low) * places
    weights = lagrange_weights(factors.ravel(), nodes).T.reshape(number, *factors.shape)
    return list(zip(nodes.tolist(), weights, strict=True))


@compiled
def lagrange_weights(x: Floats, nodes: Floats) -> Floats:
    """Return the weight of each node in a polynomial through the values at all of them, (N, M)."""
    weights = np.empty((x.size, nodes.size))
    for place in range(x.size):
        for node in range(nodes.size):
            above = below = 1.0
            for far in range(nodes.size):
                if far != node:
                    above *= x[place] - nodes[far]
                    below *= nodes[node] - nodes[far]
            weights[place, node] = above / below
    return weights


def _at_rates(
    rate_hz: Floats, exposure_s: float, effects: AvalancheEffects, share: float = 1.0
) -> Moments:
    """Mean and variance at rates of any shape, for a share of the longest time."""
    rates_hz, place = np.unique(rate_hz, return_inverse=True)
    with _one_at_a_time:  # other threads would repeat the work
        if rates_hz.size <= 8:  # few rates need no interpolation
            moments = np.array([_of_pixel(rate, exposure_s, effects)[:2] for rate in rates_hz])
            moments = moments.reshape(-1, 2)
        else:
            arrivals = np.maximum(rates_hz * exposure_s, _FEWEST_ARRIVALS)
            moments = _in_pieces(np.log10(arrivals), exposure_s, effects, share)
            moments *= (rates_hz * exposure_s / arrivals)[:, None]
    mean, variance = moments[place.ravel()].T.reshape(2, *np.shape(rate_hz))
    return mean, variance


def _in_pieces(
    log_arrivals: Floats, exposure_s: float, effects: AvalancheEffects, share: float
) -> Floats:
    """Mean and variance (N, 2) at logarithms of arrivals, for a share of the longest time."""
    moments, total_work = np.empty((log_arrivals.size, 2)), 0.0
    pieces = [(1.0, log_arrivals // 1.0, np.arange(log_arrivals.size))]
    while pieces:
        width, numbers, chosen = pieces.pop()
        for number in np.unique(numbers):
            inside = chosen[numbers == number]
            nodes = width * (number + _NODES)
            at_nodes, work = _piece(width, float(number), exposure_s, effects)
            total_work += work
            if total_work > share * 1e9:  # operations, about 20 s
                raise UserError(
                    f"mean and variance at up to {10 ** log_arrivals[-1] / exposure_s:.3g} "
                    "detections and dark counts per second take too long to compute with these "
                    "effects; lower the light or exposure_s, or ask for no expectation"
                )
            if at_nodes is None:
                pieces.append((width / 2, log_arrivals[inside] // (width / 2), inside))
                continue
            interpolator = BarycentricInterpolator(nodes, at_nodes, rng=0)
            log_mean, variance_over_mean = interpolator(log_arrivals[inside]).T
            mean = np.exp(log_mean)
            moments[inside] = np.column_stack([mean - _NO_COUNTS, variance_over_mean * mean])
    return np.maximum(moments, 0.0)


def _of_pixel(
    rate_hz: float, exposure_s: float, effects: AvalancheEffects
) -> tuple[float, float, float]:
    """Mean and variance at one rate, and operations taken."""
    rate = np.array([rate_hz])
    if is_limit(rate, exposure_s, effects, None)[0]:
        mean, variance = bright_moments(rate, exposure_s, effects, None)
        return float(mean[0]), float(variance[0]), 1.0
    return counts_of_pixel(float(rate_hz), exposure_s, effects)


@lru_cache(maxsize=4096)
def _piece(
    width: float, number: float, exposure_s: float, effects: AvalancheEffects
) -> tuple[Floats | None, float]:
    """Log of mean, and variance over mean, at the nodes (9, 2), None if uneven; operations."""
    arrivals = 10 ** (width * (number + _NODES))
    mean, variance, work = np.array(
        [_of_pixel(rate_hz, exposure_s, effects) for rate_hz in arrivals / exposure_s]
    ).T
    mean += _NO_COUNTS
    values = np.column_stack([np.log(mean), variance / mean])
    interpolated = BarycentricInterpolator(_NODES[::2], values[::2], rng=0)(_NODES[1::2])
    off_mean, off_variance = np.abs(interpolated - values[1::2]).T
    allowed = np.maximum(0.02 * variance, 0.02)[1::2] / mean[1::2]
    agrees = np.all(off_mean < 2e-3) and np.all(off_variance < allowed)
    return values if agrees else None, work.sum()
