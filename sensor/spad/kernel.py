"""Event loop over avalanches: arrivals of all pixels in order of time.

An arrival (photon or dark carrier, released carrier, crosstalk light) while the gate is closed has
no effect. In the dead time it is lost. It extends a paralyzable dead time; at the end of a
non-paralyzable one it may fire when that ends (a twilight pulse). Otherwise the pixel fires, with a
probability below 1 while it recharges. It then counts, fills traps and lights its neighbors.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Ints
from megalopta.core.compiling import compiled
from megalopta.sensor.effects.afterpulsing import draw_carriers, draw_delay
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.effects.crosstalk import neighborhoods, places_fired
from megalopta.sensor.effects.gating import is_open, open_time, wall_time
from megalopta.sensor.spad.model import AvalancheEffects

CARRIER, CROSSTALK, TWILIGHT = 0, 1, 2
KINDS = 3
# More than 32 carriers occur once in 10³⁶ avalanches.
_MOST_CARRIERS = 32
_AHEAD = 256
"""Photons of all pixels that are drawn together."""


class Parameters(NamedTuple):
    """Parameters that all pixels share; times in s."""

    exposure_s: float
    start_s: float
    is_paralyzable: bool
    is_stationary: bool
    is_coupled: bool
    """True with crosstalk: pixels affect each other"""
    columns: int
    period: tuple[int, int]
    """Rows and columns after which crosstalk repeats"""
    twilight_s: float
    recharge_s: float
    delay_s: float
    gate: tuple[float, float, float]
    """Period, width and phase; period 0: not gated"""


class Tables(NamedTuple):
    """Parameters that are arrays; numba counts references to each wherever they are passed."""

    rates: Floats
    """Arrivals per second, (S, N), in S equal parts of the exposure"""
    dead_times: Floats
    """s, (N,); this and the next two (1,) where all pixels are alike"""
    carriers: Floats
    """Mean number of carriers that an avalanche leaves in traps"""
    strengths: Floats
    """Factor on the crosstalk that a pixel sends"""
    delays_s: Floats
    cumulative: Floats
    taps: Floats
    """Down and right of every pixel that an avalanche may fire, and its probability by the place of
    the avalanche within the period"""
    totals: Floats
    """With crosstalk arrivals per second of all pixels together, (S, 1)"""
    ranks: Floats
    """Share of the arrivals in a pixel and those before it, (S, N)"""
    guide: NDArray[np.int32]
    """First pixel whose rank exceeds n/N, for n from 0, (S, N)"""


class Before(NamedTuple):
    """State left by the previous exposure; times from the start of this one."""

    is_begun: bool
    """True if there was a previous exposure"""
    dead_until: Floats
    """End of each pixel's dead time, (N,), changed in place"""
    times: Floats
    """Times of released carriers and twilight pulses"""
    owners: Ints
    """Pixel and kind of each of these, in the order of pixels"""


def parameters_of(
    rates: Floats, exposure_s: float, effects: AvalancheEffects, maps: AvalancheMaps
) -> tuple[Parameters, Tables]:
    """Parameters of the loop for effects and rates (S, rows, columns) in Hz."""
    dead_time, afterpulsing = effects.dead_time, effects.afterpulsing
    is_stationary = dead_time.start == "stationary"
    dead_times = dead_time.dead_time_s * maps.dead_time.ravel()
    forgotten_s = effects.memory_s + 20 * float(dead_times.max(initial=0)) * (
        not effects.is_closed_form
    )
    weights = neighborhoods(effects.crosstalk)
    rows, columns = weights.shape[:2]
    places = places_fired(weights)
    chances = weights.reshape(rows * columns, *weights.shape[2:])[:, places[:, 0], places[:, 1]]
    flat = np.ascontiguousarray(rates.reshape(len(rates), -1), np.float64)
    totals, ranks, guide = (
        flat.sum(1, keepdims=True),
        flat[:, :0],
        np.empty((len(flat), 0), np.int32),
    )
    if effects.crosstalk.is_on:
        ranks = np.cumsum(flat, axis=1)
        ranks /= np.maximum(ranks[:, -1:], 1e-300)
        ranks[:, -1] = 1.0
        steps = np.arange(flat.shape[1]) / flat.shape[1]
        guide = np.array([np.searchsorted(row, steps, "right") for row in ranks], np.int32)
    parameters = Parameters(
        exposure_s=exposure_s,
        start_s=-forgotten_s if is_stationary else 0.0,
        is_paralyzable=dead_time.kind == "paralyzable",
        is_stationary=is_stationary,
        is_coupled=effects.crosstalk.is_on,
        columns=rates.shape[-1],
        period=(rows, columns),
        twilight_s=dead_time.twilight_s,
        recharge_s=dead_time.recharge_s,
        delay_s=afterpulsing.delay_s,
        gate=effects.gate.window,
    )
    tables = Tables(
        rates=flat,
        dead_times=dead_times,
        carriers=afterpulsing.mean_carriers * maps.afterpulsing.ravel(),
        strengths=maps.crosstalk.ravel(),
        delays_s=np.array(afterpulsing.table_delays_s, np.float64),
        cumulative=np.array(afterpulsing.table_cumulative, np.float64),
        # always one memory order, as numba compiles the loop anew for another
        taps=np.ascontiguousarray(
            np.column_stack((places - np.array(weights.shape[2:]) // 2, chances.T))
        ),
        totals=totals,
        ranks=np.ascontiguousarray(ranks),
        guide=guide,
    )
    return parameters, tables


@compiled
def run_frame(
    rng: np.random.Generator,
    parameters: Parameters,
    tables: Tables,
    keep_events: bool,
    before: Before,
) -> tuple[Ints, tuple[Floats, Ints], tuple[Floats, Ints]]:
    """Counts; times and pixels of events; times and owners of the entries that remain.

    Pixels with crosstalk are simulated together, others one by one.
    """
    pixels = tables.rates.shape[1]
    counts = np.zeros(pixels, np.int64)
    stamps, places = np.empty(64), np.empty(64, np.int64)
    left_times, left_owners = np.empty(64), np.empty(64, np.int64)
    left, kept = 0, 0 if keep_events else -1
    block = pixels if parameters.is_coupled else 1
    entries = _most_entries(tables.taps)
    spare = 1 + entries
    times, owners = np.empty(spare), np.empty(spare, np.int64)
    dead_until = before.dead_until
    ahead_times, ahead_pixels = np.empty(_AHEAD), np.empty(_AHEAD, np.int64)
    chances = np.empty(_AHEAD)
    next_ahead = _AHEAD
    waiting = 0
    for first in range(0, pixels, block):
        size = 0
        while waiting < before.owners.size and before.owners[waiting] < KINDS * (first + block):
            if size + entries > times.size:
                times, owners = _longer(times, spare), _longer(owners, spare)
            size = _push(times, owners, size, before.times[waiting], before.owners[waiting])
            waiting += 1
        if size + spare > times.size:
            times, owners = _longer(times, spare), _longer(owners, spare)
        if not before.is_begun:
            for pixel in range(first, first + block):
                dead_until[pixel] = _first_dead_until(rng, pixel, parameters, tables)
        if parameters.is_coupled:
            photon = parameters.start_s
            _look_ahead(
                rng,
                parameters,
                tables,
                photon,
                ahead_times,
                ahead_pixels,
                chances,
                dead_until,
                counts,
            )
            next_ahead, photon = 0, ahead_times[0]
        else:
            photon = _first_photon(rng, first, parameters, tables, dead_until[first])
        while photon < parameters.exposure_s or (size > 0 and times[0] < parameters.exposure_s):
            if size + entries > times.size:
                times, owners = _longer(times, spare), _longer(owners, spare)
            if kept == stamps.size:
                stamps, places = _longer(stamps, spare), _longer(places, spare)
            size, kept, photon, next_ahead = _run(
                rng, parameters, tables, counts, dead_until, times, owners, size, stamps, places,
                kept, first, photon, ahead_times, ahead_pixels, chances, next_ahead,
            )  # fmt: skip
        for entry in range(size):
            if left == left_times.size:
                left_times, left_owners = _longer(left_times, spare), _longer(left_owners, spare)
            left_times[left], left_owners[left] = times[entry], owners[entry]
            left += 1
    events = stamps[: max(kept, 0)], places[: max(kept, 0)]
    return counts, events, (left_times[:left], left_owners[:left])


@compiled
def _most_entries(taps: Floats) -> int:
    """Entries that one avalanche may add: carriers, fired pixels and a twilight pulse."""
    entries: int = _MOST_CARRIERS + 2 + taps.shape[0]
    return entries


@compiled
def _run(  # type: ignore[no-untyped-def]
    rng, parameters, tables, counts, dead_until, times, owners, size, stamps, places, kept, pixel,
    photon, ahead_times, ahead_pixels, chances, next_ahead,
):  # fmt: skip
    """Run to the end of the exposure, or until an array is too short.

    Return size, kept, photon and next_ahead. `photon` is the time of the next photon, in `pixel`,
    or with crosstalk the next of those drawn ahead. `kept` below 0 keeps no events.
    Arrays are extended outside and passed one by one: numba counts references where arrays may
    change, and those in tuples.
    """
    exposure, is_paralyzable = parameters.exposure_s, parameters.is_paralyzable
    is_coupled, twilight, recharge = (
        parameters.is_coupled, parameters.twilight_s, parameters.recharge_s,
    )  # fmt: skip
    rates, dead_times, carriers, strengths, delays, cumulative, taps = tables[:7]
    stride = 1 if dead_times.size > 1 else 0
    most_fired = taps[:, 2:].sum(0).max() if is_coupled else 0.0
    entries = _most_entries(taps)
    gate = parameters.gate
    part_s = exposure / rates.shape[0]
    columns, period = parameters.columns, parameters.period
    while True:
        is_photon = size == 0 or photon <= times[0]
        time = photon if is_photon else times[0]
        if time >= exposure or size + entries > times.size or kept == stamps.size:
            return size, kept, photon, next_ahead
        if not is_photon:
            pixel = owners[0] // KINDS
            size = _pop(times, owners, size)
        elif is_coupled:
            pixel = ahead_pixels[next_ahead]
        tau, blind = dead_times[stride * pixel], dead_until[pixel]
        arrives = is_photon or is_open(time, *gate)
        fires = arrives and time >= blind
        if fires and recharge > 0:
            fires = rng.random() < -np.expm1(-(time - blind) / recharge)
        elif arrives and not fires:
            if is_paralyzable:
                dead_until[pixel] = max(blind, time + tau)
            elif time >= blind - twilight:
                size = _push(times, owners, size, blind, KINDS * pixel + TWILIGHT)
        if fires:
            dead_until[pixel] = time + tau
            if time >= 0:
                counts[pixel] += 1
                if kept >= 0:
                    stamps[kept], places[kept] = time, pixel
                    kept += 1
            if carriers[stride * pixel] > 0:
                for _ in range(min(draw_carriers(rng, carriers[stride * pixel]), _MOST_CARRIERS)):
                    release = time + draw_delay(rng, parameters.delay_s, delays, cumulative)
                    # an entry that is lost without effect need not be kept
                    if is_paralyzable or release >= dead_until[pixel] - twilight:
                        size = _push(times, owners, size, release, KINDS * pixel + CARRIER)
            if is_coupled:
                # one number tells the first pixel that is fired, most often none
                chance, strength = rng.random(), strengths[stride * pixel]
                if chance < most_fired * strength:
                    avalanche = time, pixel, columns, period, chance, strength
                    size = _push_crosstalk(rng, taps, times, owners, size, avalanche, counts.size)
        if is_photon and is_coupled:
            next_ahead += 1
            if next_ahead == ahead_times.size:
                _look_ahead(
                    rng,
                    parameters,
                    tables,
                    time,
                    ahead_times,
                    ahead_pixels,
                    chances,
                    dead_until,
                    counts,
                )
                next_ahead = 0
            photon = ahead_times[next_ahead]
        elif is_photon:
            # unless the dead time is extended, arrivals in it need not be drawn
            since = time if is_paralyzable else max(time, dead_until[pixel] - twilight)
            photon = _next_photon(rng, rates, pixel, since, part_s, gate)
            # photons that only extend the dead time need not be met
            while is_paralyzable and photon < min(dead_until[pixel], exposure):
                dead_until[pixel] = photon + tau
                photon = _next_photon(rng, rates, pixel, photon, part_s, gate)


@compiled
def _look_ahead(  # type: ignore[no-untyped-def]
    rng, parameters, tables, since, ahead_times, ahead_pixels, chances, dead_until, counts
):
    """Draw the next photons of all pixels: one stream, each on a pixel by its share of the rate."""
    totals, ranks, guide = tables.totals, tables.ranks, tables.guide
    part_s, parts, pixels = parameters.exposure_s / len(totals), len(totals), guide.shape[1]
    drawn = 0
    while drawn < ahead_times.size and since < parameters.exposure_s:
        since = _next_photon(rng, totals, 0, since, part_s, parameters.gate)
        ahead_times[drawn], chances[drawn] = since, rng.random()
        drawn += 1
    # short loops, in which the processor waits for many places of memory at once
    for k in range(drawn):
        part = 0 if parts == 1 else min(max(int(ahead_times[k] / part_s), 0), parts - 1)
        pixel = np.int64(guide[part, int(chances[k] * pixels)])
        while ranks[part, pixel] <= chances[k]:
            pixel += 1
        ahead_pixels[k] = pixel
    for k in range(drawn):
        chances[k] = dead_until[ahead_pixels[k]] + counts[ahead_pixels[k]]


@compiled
def _push_crosstalk(rng, taps, times, owners, size, avalanche, pixels):  # type: ignore[no-untyped-def]
    """Let an avalanche light its neighbors, given a random number for the first that is fired."""
    time, pixel, columns, period, chance, strength = avalanche
    rows, row, column = pixels // columns, pixel // columns, pixel % columns
    place = 2 + (row % period[0]) * period[1] + column % period[1]
    none = 1.0
    for tap in range(taps.shape[0]):
        none *= 1 - taps[tap, place] * strength
        if chance >= 1 - none:
            continue
        y, x = row + int(taps[tap, 0]), column + int(taps[tap, 1])
        if 0 <= y < rows and 0 <= x < columns:
            size = _push(times, owners, size, time, KINDS * (y * columns + x) + CROSSTALK)
        chance, none = rng.random(), 1.0
    return size


@compiled
def _first_dead_until(rng, pixel, parameters, tables):  # type: ignore[no-untyped-def]
    """End of the dead time in which a pixel starts; far in the past if it is live and charged."""
    start, rate = parameters.start_s, tables.rates[0, pixel]
    tau = tables.dead_times[pixel if tables.dead_times.size > 1 else 0]
    if not parameters.is_stationary or tau == 0 or rate == 0:
        return -np.inf
    if parameters.is_paralyzable:
        return start + max(tau - rng.standard_exponential() / rate, 0.0)
    is_dead = rng.random() * (1 + rate * tau) < rate * tau
    return start + tau * rng.random() if is_dead else -np.inf


@compiled
def _first_photon(rng, pixel, parameters, tables, dead_until):  # type: ignore[no-untyped-def]
    """Time of the first photon that can act, in a pixel that is dead until a given time."""
    start, twilight = parameters.start_s, parameters.twilight_s
    part_s = parameters.exposure_s / tables.rates.shape[0]
    since = start if parameters.is_paralyzable else max(start, dead_until - twilight)
    return _next_photon(rng, tables.rates, pixel, since, part_s, parameters.gate)


@compiled
def _next_photon(rng, rates, pixel, since, part_s, gate):  # type: ignore[no-untyped-def]
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
def _push(times, owners, size, time, owner):  # type: ignore[no-untyped-def]
    """Add an entry to the heap and return its new size."""
    place = size
    while place > 0 and times[(place - 1) // 2] > time:
        parent = (place - 1) // 2
        times[place], owners[place] = times[parent], owners[parent]
        place = parent
    times[place], owners[place] = time, owner
    return size + 1


@compiled
def _pop(times, owners, size):  # type: ignore[no-untyped-def]
    """Remove the first entry of the heap and return its new size."""
    size -= 1
    time, owner = times[size], owners[size]
    place, child = 0, 1
    while child < size:
        if child + 1 < size and times[child + 1] < times[child]:
            child += 1
        if times[child] >= time:
            break
        times[place], owners[place] = times[child], owners[child]
        place, child = child, 2 * child + 1
    times[place], owners[place] = time, owner
    return size


@compiled
def _longer(values, spare):  # type: ignore[no-untyped-def]
    """Return a copy of an array, of twice the length and `spare` more."""
    result = np.empty(2 * values.size + spare, values.dtype)
    # compiles in a tenth of the time of an assignment to a slice
    for place in range(values.size):
        result[place] = values[place]
    return result
