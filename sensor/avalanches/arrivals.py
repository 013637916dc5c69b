"""Successive photons and dark carriers of a pixel, and its dead time at the start."""

import numpy as np

from megalopta.core.compiling import compiled
from megalopta.sensor.effects.gating import open_time, wall_time


@compiled
def first_blind_until(rng, pixel, parameters, tables):  # type: ignore[no-untyped-def]
    """End of the dead time in which a pixel starts; far in the past if it is live and charged."""
    start, tau, rate = parameters.start_s, tables.dead_times[pixel], tables.rates[0, pixel]
    if not parameters.is_stationary or tau == 0 or rate == 0:
        return -np.inf
    if parameters.is_paralyzable:
        return start + max(tau - rng.standard_exponential() / rate, 0.0)
    is_dead = rng.random() * (1 + rate * tau) < rate * tau
    return start + tau * rng.random() if is_dead else -np.inf


@compiled
def first_photon(rng, pixel, parameters, tables, blind_until):  # type: ignore[no-untyped-def]
    """Time of the first photon that can act, in a pixel that is dead until a given time."""
    start, twilight = parameters.start_s, parameters.twilight_s
    since = start if parameters.is_paralyzable else max(start, blind_until - twilight)
    part_s = parameters.exposure_s / tables.rates.shape[0]
    return next_photon(rng, tables.rates, pixel, since, part_s, parameters.gate)


@compiled
def next_photon(rng, rates, pixel, since, part_s, gate):  # type: ignore[no-untyped-def]
    """Time of the next photon or dark carrier after a time; infinite if there is none."""
    wait = rng.standard_exponential()
    last = rates.shape[0] - 1
    part = min(max(int(since / part_s), 0), last) if last > 0 else 0
    while part < last:
        # arrivals that fit into a part of the exposure
        end = (part + 1) * part_s
        left = (open_time(end, *gate) - open_time(since, *gate)) * rates[part, pixel]
        if wait < left:
            break
        wait, since, part = wait - max(left, 0.0), end, part + 1
    if rates[part, pixel] == 0:
        return np.inf
    return wall_time(open_time(since, *gate) + wait / rates[part, pixel], *gate)


@compiled
def mean_photons(rates, pixel, since, until, part_s, gate):  # type: ignore[no-untyped-def]
    """Mean number of photons and dark carriers between two times."""
    total, since = 0.0, max(since, 0.0)
    last = rates.shape[0] - 1
    while since < until:
        part = min(int(since / part_s), last)
        end = until if part == last else min(until, (part + 1) * part_s)
        total += rates[part, pixel] * (open_time(end, *gate) - open_time(since, *gate))
        since = end
    return total
