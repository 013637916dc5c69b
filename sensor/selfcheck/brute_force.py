"""Counts by the plainest possible simulation, to hold the others against.

Photon after photon, and of the released carriers whichever comes first, found by looking at all of
them; nothing is skipped, no law is used. Light that changes is thinned out of the brightest. A
closed gate drops what arrives. A stationary start is a live one a long time earlier, long enough
for dead times to lose their rhythm; frames that follow on each other are cut from one run. Slow on
purpose, and shares no code with what it checks.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.sensor.effects import AvalancheEffects, AvalancheMaps, Crosstalk

_MOST_PENDING = 4096
_DEAD_TIMES_TO_FORGET = 300


class _Pixels(NamedTuple):
    rates: Floats
    dead_times: Floats
    carriers: Floats
    chances: Floats


def brute_force_counts(
    rng: np.random.Generator,
    rate_hz: float,
    exposure_s: float,
    effects: AvalancheEffects,
    exposures: int,
) -> NDArray[np.int64]:
    """Counts of so many exposures of one pixel; no crosstalk."""
    rates, alone = np.full((1, 1), rate_hz), effects.without_crosstalk
    return brute_force_frames(rng, rates, exposure_s, alone, exposures).ravel()


def brute_force_frames(
    rng: np.random.Generator,
    rate_hz: Floats,
    exposure_s: float,
    effects: AvalancheEffects,
    exposures: int,
    *,
    maps: AvalancheMaps | None = None,
    frames: int = 1,
) -> NDArray[np.int64]:
    """Counts of so many exposures of an array, (exposures, frames, rows, columns).

    Parameters
    ----------
    rate_hz : (rows, columns) or (S, rows, columns) float64
        Rate of arrivals, constant or in S equal parts of an exposure.
    maps : AvalancheMaps, optional
        How pixels differ.
    frames : int
        How many exposures follow on each other without a new start.
    """
    dead_time, traps = effects.dead_time, effects.afterpulsing
    rates = rate_hz if rate_hz.ndim == 3 else rate_hz[None]
    parts, rows, columns = rates.shape
    maps = maps or AvalancheMaps.alike((rows, columns))
    tau = 0.0 if dead_time.kind == "ideal" else dead_time.dead_time_s
    pixels = _Pixels(
        rates.reshape(parts, -1),
        tau * maps.dead_time.ravel(),
        traps.mean_carriers * maps.afterpulsing.ravel(),
        _chances(effects.crosstalk, rows, columns) * maps.crosstalk.ravel()[:, None],
    )
    counts: NDArray[np.int64] = _simulate(
        rng,
        pixels,
        (exposure_s, run_up_s(effects), dead_time.twilight_s, dead_time.recharge_s),
        dead_time.kind == "paralyzable",
        traps.delay_s,
        (np.array(traps.table_delays_s), np.array(traps.table_cumulative)),
        effects.gate.window,
        (exposures, frames),
    )
    return counts.reshape(exposures, frames, rows, columns)


def run_up_s(effects: AvalancheEffects) -> float:
    """Time simulated before the exposure, s."""
    dead_time, traps = effects.dead_time, effects.afterpulsing
    if dead_time.start == "live":
        return 0.0
    tau = 0.0 if dead_time.kind == "ideal" else dead_time.dead_time_s
    return _DEAD_TIMES_TO_FORGET * (tau + dead_time.recharge_s) + traps.memory_s * traps.is_on


def _chances(talk: Crosstalk, rows: int, columns: int) -> Floats:
    """Probability that an avalanche of the first pixel fires the second, (N, N), by distance."""
    y, x = np.indices((rows, columns)).reshape(2, -1)
    squared = (y[:, None] - y) ** 2 + (x[:, None] - x) ** 2
    straight = (y[:, None] == y) | (x[:, None] == x)
    shares = [1.0, talk.diagonal, talk.distance_two, talk.distance_three]
    relative = np.select(
        [squared == 1, squared == 2, straight & (squared == 4), straight & (squared == 9)], shares
    )
    return np.asarray(talk.mean_fired_neighbors * relative / (4 * sum(shares)))


@njit(cache=True, nogil=True)
def _simulate(rng, pixels, times, extends, delay, table, gate, repeats):  # type: ignore[no-untyped-def]
    exposure, run_up, twilight, recharge = times
    rates, dead_times, carriers, chances = pixels
    parts, size = rates.shape
    brightest = np.array([rates[:, pixel].max() for pixel in range(size)])
    counts = np.zeros((repeats[0], repeats[1], size), np.int64)
    when, where = np.empty(_MOST_PENDING), np.empty(_MOST_PENDING, np.int64)
    photons, blind_until = np.empty(size), np.empty(size)
    for index in range(repeats[0]):
        pending = 0
        for pixel in range(size):
            blind_until[pixel] = -np.inf
            photons[pixel] = np.inf
            if brightest[pixel] > 0:
                photons[pixel] = -run_up + rng.exponential(1 / brightest[pixel])
        while True:
            first, pixel = -1, 0
            for other in range(1, size):
                if photons[other] < photons[pixel]:
                    pixel = other
            now = photons[pixel]
            for carrier in range(pending):
                if when[carrier] < now:
                    first, now = carrier, when[carrier]
            if now >= exposure * repeats[1]:
                break
            if first < 0:
                photons[pixel] = now + rng.exponential(1 / brightest[pixel])
                part = int((now % exposure) / exposure * parts) if now > 0 else 0
                if rng.random() * brightest[pixel] >= rates[part, pixel]:
                    continue
            else:
                pending -= 1
                pixel = where[first]
                when[first], where[first] = when[pending], where[pending]
            if gate[0] > 0 and (now - gate[2]) % gate[0] >= gate[1]:
                continue
            # the avalanches of one instant, those fired by light of the others included
            struck = [pixel]
            while len(struck) > 0:
                pixel = struck.pop()
                since = now - blind_until[pixel]
                tau = dead_times[pixel]
                if since < 0:
                    if extends:
                        blind_until[pixel] = now + tau
                    elif -since <= twilight and pending < _MOST_PENDING:
                        when[pending], where[pending] = blind_until[pixel], pixel
                        pending += 1
                    continue
                if recharge > 0 and rng.random() >= 1 - np.exp(-since / recharge):
                    continue
                blind_until[pixel] = now + tau
                if now >= 0:
                    counts[index, int(now / exposure), pixel] += 1
                filled = rng.poisson(carriers[pixel]) if carriers[pixel] > 0 else 0
                for _ in range(filled):
                    if table[0].size > 0:
                        later = np.interp(rng.random(), table[1], table[0])
                    else:
                        later = rng.exponential(delay)
                    when[pending], where[pending] = now + later, pixel
                    pending += 1
                for other in range(size):
                    if chances[pixel, other] > 0 and rng.random() < chances[pixel, other]:
                        struck.append(other)
    return counts
