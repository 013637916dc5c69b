"""The loop over avalanches: arrivals of all pixels in the order of time.

An arrival (photon or dark carrier, released carrier, crosstalk light) while the gate is closed does
nothing. In the dead time it is lost; it extends a paralyzable one, and in the last moments of a
non-paralyzable one it waits for its end and fires then (a twilight pulse). Else the pixel fires,
while it recharges with a probability below 1, and then counts, fills traps and lights its
neighbors.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from megalopta.sensor.avalanches.heap import longer, pop, push
from megalopta.sensor.effects import draw_carriers, draw_delay, is_open, open_time, wall_time

PHOTON, CARRIER, CROSSTALK, TWILIGHT = 0, 1, 2, 3
KINDS = 4
# Entries that one avalanche may add. More carriers than 32 come once in 10³⁶ avalanches.
_MOST_CARRIERS = 32
_ROOM = _MOST_CARRIERS + 18

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Parameters(NamedTuple):
    """What is the same in every pixel; times in s."""

    exposure_s: float
    start_s: float
    is_paralyzable: bool
    is_stationary: bool
    twilight_s: float
    recharge_s: float
    delay_s: float
    period_s: float
    width_s: float
    phase_s: float


class Tables(NamedTuple):
    """Parameters that are arrays: numba counts a reference to each wherever they are passed."""

    rates: Floats
    """Arrivals per second, (S, N), in S equal parts of the exposure"""
    dead_times: Floats
    """s, (N,)"""
    carriers: Floats
    """Mean number that an avalanche leaves in traps, (N,)"""
    strengths: Floats
    """Factor on the crosstalk that a pixel sends, (N,)"""
    delays_s: Floats
    cumulative: Floats
    taps: Floats
    """Down, right and probability of every pixel that an avalanche may fire"""


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def run_frame(
    rng: np.random.Generator,
    parameters: Parameters,
    tables: Tables,
    columns: int,
    is_coupled: bool,
    keep_events: bool,
    blind_until: Floats,
    is_begun: bool,
    pending: tuple[Floats, Ints],
) -> tuple[Ints, tuple[Floats, Ints], tuple[Floats, Ints]]:
    """Counts; times and pixels of events; times and owners of what is left for the next exposure.

    `blind_until`, the end of each pixel's dead time, is changed in place; it counts at the start
    only where the exposure `is_begun`, that is follows on another. `pending` is in the order of
    pixels.
    """
    pixels = tables.dead_times.size
    counts = np.zeros(pixels, np.int64)
    stamps, places = np.empty(64), np.empty(64, np.int64)
    left_times, left_owners = np.empty(64), np.empty(64, np.int64)
    left, kept = 0, 0 if keep_events else -1
    block = pixels if is_coupled else 1
    times, owners = np.empty(block + _ROOM), np.empty(block + _ROOM, np.int64)
    waiting = 0
    for first in range(0, pixels, block):
        if not is_begun:
            for pixel in range(first, first + block):
                blind_until[pixel] = _first_blind_until(rng, pixel, parameters, tables)
        size = 0
        while waiting < pending[1].size and pending[1][waiting] < KINDS * (first + block):
            if size + _ROOM > times.size:
                times, owners = longer(times, _ROOM), longer(owners, _ROOM)
            size = push(times, owners, size, pending[0][waiting], pending[1][waiting])
            waiting += 1
        if size + block + _ROOM > times.size:
            times, owners = longer(times, block + _ROOM), longer(owners, block + _ROOM)
        for pixel in range(first, first + block):
            arrival = _first_photon(rng, pixel, parameters, tables, blind_until[pixel])
            size = push(times, owners, size, arrival, KINDS * pixel + PHOTON)
        while size > 0 and times[0] < parameters.exposure_s:
            # arrays are made longer here, as numba counts references where they may change
            if size + _ROOM > times.size:
                times, owners = longer(times, _ROOM), longer(owners, _ROOM)
            if kept == stamps.size:
                stamps, places = longer(stamps, _ROOM), longer(places, _ROOM)
            size, kept = _run(
                rng, parameters, tables, columns, is_coupled, counts, blind_until, times, owners,
                size, stamps, places, kept,
            )  # fmt: skip
        for entry in range(size):
            # photons come without memory, so that the next exposure draws its own
            if owners[entry] % KINDS != PHOTON:
                if left == left_times.size:
                    left_times, left_owners = longer(left_times, 0), longer(left_owners, 0)
                left_times[left], left_owners[left] = times[entry], owners[entry]
                left += 1
    events = stamps[: max(kept, 0)], places[: max(kept, 0)]
    return counts, events, (left_times[:left], left_owners[:left])


@njit(cache=True, nogil=True, error_model="numpy")
def _run(  # type: ignore[no-untyped-def]
    rng, parameters, tables, columns, is_coupled, counts, blind_until, times, owners, size,
    stamps, places, kept,
):  # fmt: skip
    """Go on to the end of the exposure, or until an array is too short; return size and kept.

    `kept` below 0 keeps no events.
    """
    exposure, is_paralyzable = parameters.exposure_s, parameters.is_paralyzable
    twilight, recharge, delay_s = (
        parameters.twilight_s,
        parameters.recharge_s,
        parameters.delay_s,
    )
    rates, dead_times, carriers, _, delays, cumulative, _ = tables
    gate = parameters.period_s, parameters.width_s, parameters.phase_s
    part_s = exposure / rates.shape[0]
    while size > 0 and times[0] < exposure:
        if size + _ROOM > times.size or kept == stamps.size:
            return size, kept
        time, pixel, kind = times[0], owners[0] // KINDS, owners[0] % KINDS
        size = pop(times, owners, size)
        tau, blind = dead_times[pixel], blind_until[pixel]
        arrives = kind == PHOTON or is_open(time, *gate)
        fires = arrives and time >= blind
        if fires and recharge > 0:
            fires = rng.random() < -np.expm1(-(time - blind) / recharge)
        elif arrives and not fires:
            if is_paralyzable:
                blind_until[pixel] = max(blind, time + tau)
            elif time >= blind - twilight:
                size = push(times, owners, size, blind, KINDS * pixel + TWILIGHT)
        if fires:
            blind_until[pixel] = time + tau
            if time >= 0:
                counts[pixel] += 1
                if kept >= 0:
                    stamps[kept], places[kept] = time, pixel
                    kept += 1
            if carriers[pixel] > 0:
                for _ in range(min(draw_carriers(rng, carriers[pixel]), _MOST_CARRIERS)):
                    release = time + draw_delay(rng, delay_s, delays, cumulative)
                    # one that is lost without effect need not be kept
                    if is_paralyzable or release >= blind_until[pixel] - twilight:
                        size = push(times, owners, size, release, KINDS * pixel + CARRIER)
            if is_coupled:
                size = _push_crosstalk(rng, tables, times, owners, size, time, pixel, columns)
        if kind == PHOTON:
            # where the dead time is not extended, arrivals in it need not be drawn
            since = time if is_paralyzable else max(time, blind_until[pixel] - twilight)
            arrival = _next_photon(rng, rates, pixel, since, part_s, gate)
            # photons that only extend the dead time need not go through the heap
            while is_paralyzable and arrival < min(blind_until[pixel], exposure):
                blind_until[pixel] = arrival + tau
                arrival = _next_photon(rng, rates, pixel, arrival, part_s, gate)
            size = push(times, owners, size, arrival, KINDS * pixel + PHOTON)
    return size, kept


@njit(cache=True, nogil=True, error_model="numpy")
def _first_blind_until(rng, pixel, parameters, tables):  # type: ignore[no-untyped-def]
    """End of the dead time that a pixel starts in; long ago if it is live and charged."""
    start, tau, rate = parameters.start_s, tables.dead_times[pixel], tables.rates[0, pixel]
    if not parameters.is_stationary or tau == 0 or rate == 0:
        return -np.inf
    if parameters.is_paralyzable:
        return start + max(tau - rng.standard_exponential() / rate, 0.0)
    is_dead = rng.random() * (1 + rate * tau) < rate * tau
    return start + tau * rng.random() if is_dead else -np.inf


@njit(cache=True, nogil=True, error_model="numpy")
def _first_photon(rng, pixel, parameters, tables, blind_until):  # type: ignore[no-untyped-def]
    start, twilight = parameters.start_s, parameters.twilight_s
    gate = parameters.period_s, parameters.width_s, parameters.phase_s
    since = start if parameters.is_paralyzable else max(start, blind_until - twilight)
    part_s = parameters.exposure_s / tables.rates.shape[0]
    return _next_photon(rng, tables.rates, pixel, since, part_s, gate)


@njit(cache=True, nogil=True, error_model="numpy")
def _next_photon(rng, rates, pixel, since, part_s, gate):  # type: ignore[no-untyped-def]
    """Time of the first photon or dark carrier after a time; infinite where none comes."""
    wait = rng.standard_exponential()
    last = rates.shape[0] - 1
    part = min(max(int(since / part_s), 0), last) if last > 0 else 0
    while part < last:
        # arrivals that a part of the exposure has room for
        end = (part + 1) * part_s
        left = (_opened(end, gate) - _opened(since, gate)) * rates[part, pixel]
        if wait < left:
            break
        wait, since, part = wait - max(left, 0.0), end, part + 1
    if rates[part, pixel] == 0:
        return np.inf
    opened = wait / rates[part, pixel]
    if gate[0] == 0:
        return since + opened
    return wall_time(open_time(since, *gate) + opened, *gate)


@njit(cache=True, nogil=True, error_model="numpy")
def _opened(time, gate):  # type: ignore[no-untyped-def]
    return time if gate[0] == 0 else open_time(time, *gate)


@njit(cache=True, nogil=True, error_model="numpy")
def _push_crosstalk(  # type: ignore[no-untyped-def]
    rng, tables, times, owners, size, time, pixel, columns
):
    taps, strength = tables.taps, tables.strengths[pixel]
    rows, row, column = tables.strengths.size // columns, pixel // columns, pixel % columns
    for tap in range(taps.shape[0]):
        y, x = row + int(taps[tap, 0]), column + int(taps[tap, 1])
        is_inside = 0 <= y < rows and 0 <= x < columns
        if is_inside and rng.random() < taps[tap, 2] * strength:
            size = push(times, owners, size, time, KINDS * (y * columns + x) + CROSSTALK)
    return size
