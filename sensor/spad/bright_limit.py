"""Mean and variance of counts in light so bright that few waits for an arrival matter.

    paralyzable        dead for good after the first arrival, so dead time alone tells the counts
    non-paralyzable    gaps of the dead time and a wait, far shorter: the waits of n gaps together
                       follow a gamma distribution, and many gaps are a normal number
    with a gate        closed for a dead time or more: every window starts live, and its counts
                       are those of dead time alone in an exposure as long

After a dead time τ, p carriers released after a delay d shorten the next wait as more arrivals
would, (p/τ)·x/(eˣ − 1) per second with x = τ/d. Neglected is (p/rτ)², and that their number
changes: 2·p/(rτ)² of the variance.
"""

import numpy as np
from scipy.integrate import simpson
from scipy.special import gammainc

from megalopta.core.arrays import Floats, Mask
from megalopta.sensor.effects import dead_time
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.effects.gating import open_time
from megalopta.sensor.spad.model import AvalancheEffects

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
        wait_s, square_s2 = _recharging(rate_hz, dead.recharge_s)
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


def _recharging(rate_hz: Floats, recharge_s: float) -> Moments:
    """Mean wait (s) of a pixel that recharges, and its mean square."""
    arrivals = (rate_hz * recharge_s)[..., None]
    x = (np.sqrt(80 / arrivals) + 40 / arrivals) * np.linspace(0, 1, 129)
    waiting = np.exp(-arrivals * (x + np.expm1(-x)))
    mean, half_square = simpson(waiting, x=x), simpson(x * waiting, x=x)
    return recharge_s * mean, 2 * recharge_s**2 * half_square


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
