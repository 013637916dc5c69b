"""Event loop over avalanches: arrivals of all pixels in order of time.

An arrival (photon or dark carrier, released carrier, crosstalk light) while the gate is closed has
no effect. In the dead time it is lost. It extends a paralyzable dead time; at the end of a
non-paralyzable one it may fire when that ends (a twilight pulse). Otherwise the pixel fires, with a
probability below 1 while it recharges. It then counts, fills traps and lights its neighbors.
"""

from typing import Any, NamedTuple

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
ENTRY = np.dtype([("time_s", "f8"), ("owner", "i8")])
"""Time of an arrival, and its pixel times `KINDS` plus its kind; pixel alone of photons, events."""
Entries = NDArray[Any]
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
    shape: tuple[int, int]
    """Rows and columns"""
    period: tuple[int, int]
    """Rows and columns after which crosstalk repeats"""
    most_fired: float
    """Sum of the probabilities of crosstalk, in the place where it is largest"""
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
    ranks, guide = flat[:, :0], np.empty((len(flat), 0), np.int32)
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
        shape=(rates.shape[1], rates.shape[2]),
        period=(rows, columns),
        most_fired=effects.crosstalk.most_fired * (1 + 1e-9),
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
        totals=flat.sum(1, keepdims=True),
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
    dead_until: Floats,
    pending: Entries,
    arrivals: tuple[Floats, Ints],
) -> tuple[Ints, Entries, Entries]:
    """Counts, events and the entries that remain, whose times are after the exposure.

    `dead_until` (N,), changed in place, is NaN where no exposure came before; `pending` are entries
    left by it, in the order of pixels. Pixels with crosstalk are simulated together, others one by
    one. `arrivals`: times in their order, the last infinite, and pixels of photons instead of those
    drawn here, for pixels that are simulated together; or empty.
    """
    pixels, exposure_s = tables.rates.shape[1], parameters.exposure_s
    counts = np.zeros(pixels, np.int64)
    # carriers, fired pixels and a twilight pulse
    spare = _MOST_CARRIERS + tables.taps.shape[0] + 2
    heap, events, left = np.empty(spare, ENTRY), np.empty(64, ENTRY), np.empty(64, ENTRY)
    # times, pixels and random numbers of photons
    ahead = np.empty(_AHEAD), np.empty(_AHEAD, np.int64), np.empty(_AHEAD)
    block = pixels if parameters.is_coupled else 1
    waiting, remaining, kept = 0, 0, 0 if keep_events else -1
    for first in range(0, pixels, block):
        size = 0
        while waiting < pending.size and pending[waiting].owner < KINDS * (first + block):
            if size == heap.size:
                heap = _longer(heap, spare)
            size = _push(heap, size, pending[waiting].time_s, pending[waiting].owner)
            waiting += 1
        for pixel in range(first, first + block):
            if np.isnan(dead_until[pixel]):
                dead_until[pixel] = _first_dead_until(rng, pixel, parameters, tables)
        if arrivals[0].size > 0:
            ahead = arrivals[0], arrivals[1], np.empty(0)
        elif parameters.is_coupled:
            _look_ahead(rng, parameters, tables, parameters.start_s, ahead, dead_until, counts)
        else:
            ahead[1][0] = first
            ahead[0][0] = _first_photon(rng, first, parameters, tables, dead_until[first])
        place = 0  # of the next photon among those drawn ahead
        while min(ahead[0][place], heap[0].time_s if size > 0 else np.inf) < exposure_s:
            if size + spare > heap.size:
                heap = _longer(heap, spare)
            if kept == events.size:
                events = _longer(events, spare)
            size, kept, place = _run(
                rng, parameters, tables, counts, dead_until, heap, events, ahead, size, kept, place
            )
        if remaining + size > left.size:
            left = _longer(left, size)
        for entry in range(size):
            left[remaining + entry] = heap[entry]
        remaining += size
    return counts, events[: max(kept, 0)], left[:remaining]


@compiled
def _run(  # type: ignore[no-untyped-def]
    rng, parameters, tables, counts, dead_until, heap, events, ahead, size, kept, place
):
    """Run to the end of the exposure, or until heap or events are full; return their numbers."""
    # arrays are extended outside: numba counts references where they may change
    exposure_s, is_paralyzable = parameters.exposure_s, parameters.is_paralyzable
    is_coupled, twilight_s = parameters.is_coupled, parameters.twilight_s
    rates, dead_times, carriers, strengths, delays_s, cumulative, taps = tables[:7]
    stride = 1 if dead_times.size > 1 else 0
    spare, gate, part_s = (
        _MOST_CARRIERS + taps.shape[0] + 2,
        parameters.gate,
        exposure_s / len(rates),
    )
    photons_s, photon_pixels, _ = ahead
    while True:
        photon = photons_s[place]
        is_photon = size == 0 or photon <= heap[0].time_s
        time = photon if is_photon else heap[0].time_s
        if time >= exposure_s or size + spare > heap.size or kept == events.size:
            return size, kept, place
        if is_photon:
            pixel = photon_pixels[place]
        else:
            pixel = heap[0].owner // KINDS
            size = _pop(heap, size)
        dead_s, blind_until = dead_times[stride * pixel], dead_until[pixel]
        arrives = is_photon or is_open(time, *gate)
        fires = arrives and time >= blind_until
        if fires and parameters.recharge_s > 0:
            fires = rng.random() < -np.expm1(-(time - blind_until) / parameters.recharge_s)
        elif arrives and not fires:
            if is_paralyzable:
                dead_until[pixel] = max(blind_until, time + dead_s)
            elif time >= blind_until - twilight_s:
                size = _push(heap, size, blind_until, KINDS * pixel + TWILIGHT)
        if fires:
            dead_until[pixel] = time + dead_s
            if time >= 0:
                counts[pixel] += 1
                if kept >= 0:
                    events[kept].time_s, events[kept].owner = time, pixel
                    kept += 1
            if carriers[stride * pixel] > 0:
                for _ in range(min(draw_carriers(rng, carriers[stride * pixel]), _MOST_CARRIERS)):
                    release_s = time + draw_delay(rng, parameters.delay_s, delays_s, cumulative)
                    # an entry that is lost without effect need not be kept
                    if is_paralyzable or release_s >= dead_until[pixel] - twilight_s:
                        size = _push(heap, size, release_s, KINDS * pixel + CARRIER)
            if is_coupled:
                # one number tells the first pixel that is fired, most often none
                chance, strength = rng.random(), strengths[stride * pixel]
                if chance < parameters.most_fired * strength:
                    avalanche = time, pixel, chance, strength
                    size = _light_neighbors(rng, parameters, taps, heap, size, avalanche)
        if is_photon and is_coupled:
            place += 1
            if place == photons_s.size:
                _look_ahead(rng, parameters, tables, time, ahead, dead_until, counts)
                place = 0
        elif is_photon:
            # unless the dead time is extended, arrivals in it need not be drawn
            since = time if is_paralyzable else max(time, dead_until[pixel] - twilight_s)
            photon = _next_photon(rng, rates, pixel, since, part_s, gate)
            # photons that only extend the dead time need not be met
            while is_paralyzable and photon < min(dead_until[pixel], exposure_s):
                dead_until[pixel] = photon + dead_s
                photon = _next_photon(rng, rates, pixel, photon, part_s, gate)
            photons_s[place] = photon


@compiled
def _light_neighbors(rng, parameters, taps, heap, size, avalanche):  # type: ignore[no-untyped-def]
    """Let an avalanche light its neighbors, given a random number for the first that is fired."""
    time, pixel, chance, strength = avalanche
    rows, columns = parameters.shape
    period, row, column = parameters.period, pixel // columns, pixel % columns
    place = 2 + (row % period[0]) * period[1] + column % period[1]
    none = 1.0
    for tap in range(taps.shape[0]):
        none *= 1 - taps[tap, place] * strength
        if chance >= 1 - none:
            continue
        y, x = row + int(taps[tap, 0]), column + int(taps[tap, 1])
        if 0 <= y < rows and 0 <= x < columns:
            size = _push(heap, size, time, KINDS * (y * columns + x) + CROSSTALK)
        chance, none = rng.random(), 1.0
    return size


@compiled
def _look_ahead(rng, parameters, tables, since, ahead, dead_until, counts):  # type: ignore[no-untyped-def]
    """Draw the next photons of all pixels: one stream, each on a pixel by its share of the rate."""
    totals, ranks, guide = tables.totals, tables.ranks, tables.guide
    parts, pixels = guide.shape
    photons_s, photon_pixels, chances = ahead
    part_s, drawn = parameters.exposure_s / parts, 0
    while drawn < photons_s.size and since < parameters.exposure_s:
        since = _next_photon(rng, totals, 0, since, part_s, parameters.gate)
        photons_s[drawn], chances[drawn] = since, rng.random()
        drawn += 1
    # short loops, in which the processor waits for many places of memory at once
    for k in range(drawn):
        part = 0 if parts == 1 else min(max(int(photons_s[k] / part_s), 0), parts - 1)
        pixel = np.int64(guide[part, int(chances[k] * pixels)])
        while ranks[part, pixel] <= chances[k]:
            pixel += 1
        photon_pixels[k] = pixel
    for k in range(drawn):
        chances[k] = dead_until[photon_pixels[k]] + counts[photon_pixels[k]]


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
def _push(heap, size, time, owner):  # type: ignore[no-untyped-def]
    """Add an entry to the heap and return its new size."""
    place = size
    while place > 0 and heap[(place - 1) // 2].time_s > time:
        heap[place] = heap[(place - 1) // 2]
        place = (place - 1) // 2
    heap[place].time_s, heap[place].owner = time, owner
    return size + 1


@compiled
def _pop(heap, size):  # type: ignore[no-untyped-def]
    """Remove the first entry of the heap and return its new size."""
    size -= 1
    place, child = 0, 1
    while child < size:
        if child + 1 < size and heap[child + 1].time_s < heap[child].time_s:
            child += 1
        if heap[child].time_s >= heap[size].time_s:
            break
        heap[place] = heap[child]
        place, child = child, 2 * child + 1
    heap[place] = heap[size]
    return size


@compiled
def _longer(entries, spare):  # type: ignore[no-untyped-def]
    """Return a copy of entries, of twice the length and `spare` more."""
    result = np.empty(2 * entries.size + spare, ENTRY)
    for place in range(entries.size):
        result[place] = entries[place]
    return result
