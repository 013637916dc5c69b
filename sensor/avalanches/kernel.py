"""Event loop over avalanches: arrivals of all pixels in order of time.

An arrival (photon or dark carrier, released carrier, crosstalk light) while the gate is closed has
no effect. In the dead time it is lost. It extends a paralyzable dead time; at the end of a
non-paralyzable one it may fire when that ends (a twilight pulse). Otherwise the pixel fires, with a
probability below 1 while it recharges. It then counts, fills traps and lights its neighbors.
"""

from typing import NamedTuple

import numpy as np

from megalopta.core.arrays import Floats, Ints
from megalopta.core.compiling import compiled
from megalopta.sensor.avalanches.arrivals import (
    first_blind_until,
    first_photon,
    mean_photons,
    next_photon,
)
from megalopta.sensor.avalanches.heap import longer, pop, push
from megalopta.sensor.effects.afterpulsing import draw_carriers, draw_delay
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.effects.crosstalk import neighborhoods, places_fired
from megalopta.sensor.effects.fields import AvalancheEffects
from megalopta.sensor.effects.gating import is_open

PHOTON, CARRIER, CROSSTALK, TWILIGHT = 0, 1, 2, 3
KINDS = 4
# More than 32 carriers occur once in 10³⁶ avalanches.
_MOST_CARRIERS = 32


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
    """s, (N,)"""
    carriers: Floats
    """Mean number of carriers that an avalanche leaves in traps, (N,)"""
    strengths: Floats
    """Factor on the crosstalk that a pixel sends, (N,)"""
    delays_s: Floats
    cumulative: Floats
    taps: Floats
    """Down and right of every pixel that an avalanche may fire, and its probability by the place of
    the avalanche within the period"""


class Before(NamedTuple):
    """State left by the previous exposure; times from the start of this one."""

    is_begun: bool
    """True if there was a previous exposure"""
    blind_until: Floats
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
    forgotten_s = effects.memory_s + 20 * float(dead_times.max(initial=0)) * (not effects.has_law)
    weights = neighborhoods(effects.crosstalk)
    rows, columns = weights.shape[:2]
    places = places_fired(weights)
    chances = weights.reshape(rows * columns, *weights.shape[2:])[:, places[:, 0], places[:, 1]]
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
        rates=np.ascontiguousarray(rates.reshape(len(rates), -1), np.float64),
        dead_times=dead_times,
        carriers=afterpulsing.mean_carriers * maps.afterpulsing.ravel(),
        strengths=maps.crosstalk.ravel(),
        delays_s=np.array(afterpulsing.table_delays_s, np.float64),
        cumulative=np.array(afterpulsing.table_cumulative, np.float64),
        # always one memory order, as numba compiles the loop anew for another
        taps=np.ascontiguousarray(
            np.column_stack((places - np.array(weights.shape[2:]) // 2, chances.T))
        ),
    )
    return parameters, tables


@compiled
def run_frame(
    rng: np.random.Generator,
    parameters: Parameters,
    tables: Tables,
    keep_events: bool,
    before: Before,
) -> tuple[Ints, Floats, tuple[Floats, Ints], tuple[Floats, Ints]]:
    """Counts; tally; times and pixels of events; times and owners of the entries that remain.

    The tally (3, N) is the number of photons and dark carriers that met a live pixel, its mean
    given the live time, and the number of trapped carriers. Pixels with crosstalk share a queue;
    others are simulated one by one.
    """
    pixels = tables.dead_times.size
    counts, tally = np.zeros(pixels, np.int64), np.zeros((3, pixels))
    stamps, places = np.empty(64), np.empty(64, np.int64)
    left_times, left_owners = np.empty(64), np.empty(64, np.int64)
    left, kept = 0, 0 if keep_events else -1
    block = pixels if parameters.is_coupled else 1
    entries = _most_entries(tables.taps)
    spare = block + entries
    exposure, part_s = parameters.exposure_s, parameters.exposure_s / len(tables.rates)
    times, owners = np.empty(spare), np.empty(spare, np.int64)
    blind_until = before.blind_until
    waiting = 0
    for first in range(0, pixels, block):
        size = 0
        while waiting < before.owners.size and before.owners[waiting] < KINDS * (first + block):
            if size + entries > times.size:
                times, owners = longer(times, spare), longer(owners, spare)
            size = push(times, owners, size, before.times[waiting], before.owners[waiting])
            waiting += 1
        if size + spare > times.size:
            times, owners = longer(times, spare), longer(owners, spare)
        if not before.is_begun:
            for pixel in range(first, first + block):
                blind_until[pixel] = first_blind_until(rng, pixel, parameters, tables)
        for pixel in range(first, first + block):
            arrival = first_photon(rng, pixel, parameters, tables, blind_until[pixel])
            size = push(times, owners, size, arrival, KINDS * pixel + PHOTON)
        while size > 0 and times[0] < exposure:
            if size + entries > times.size:
                times, owners = longer(times, spare), longer(owners, spare)
            if kept == stamps.size:
                stamps, places = longer(stamps, spare), longer(places, spare)
            size, kept = _run(
                rng, parameters, tables, counts, tally, blind_until, times, owners, size, stamps,
                places, kept,
            )  # fmt: skip
        for pixel in range(first, first + block):
            tally[1, pixel] += mean_photons(
                tables.rates, pixel, blind_until[pixel], exposure, part_s, parameters.gate
            )
        for entry in range(size):
            # photons are memoryless, so the next exposure draws its own
            if owners[entry] % KINDS != PHOTON:
                if left == left_times.size:
                    left_times, left_owners = longer(left_times, spare), longer(left_owners, spare)
                left_times[left], left_owners[left] = times[entry], owners[entry]
                left += 1
    events = stamps[: max(kept, 0)], places[: max(kept, 0)]
    return counts, tally, events, (left_times[:left], left_owners[:left])


@compiled
def _most_entries(taps: Floats) -> int:
    """Entries that one avalanche may add: carriers, fired pixels, a photon and a twilight pulse."""
    entries: int = _MOST_CARRIERS + 2 + taps.shape[0]
    return entries


@compiled
def _run(  # type: ignore[no-untyped-def]
    rng, parameters, tables, counts, tally, blind_until, times, owners, size, stamps, places, kept
):
    """Run to the end of the exposure, or until an array is too short; return size and kept.

    `kept` below 0 keeps no events. Arrays are extended outside and passed one by one: numba counts
    references where arrays may change, and those in tuples.
    """
    exposure, is_paralyzable = parameters.exposure_s, parameters.is_paralyzable
    twilight, recharge = parameters.twilight_s, parameters.recharge_s
    rates, dead_times, carriers, _, delays, cumulative, taps = tables
    entries = _most_entries(taps)
    gate = parameters.gate
    part_s = exposure / rates.shape[0]
    while size > 0 and times[0] < exposure:
        if size + entries > times.size or kept == stamps.size:
            return size, kept
        time, pixel, kind = times[0], owners[0] // KINDS, owners[0] % KINDS
        size = pop(times, owners, size)
        tau, blind = dead_times[pixel], blind_until[pixel]
        arrives = kind == PHOTON or is_open(time, *gate)
        fires = arrives and time >= blind
        if fires and kind == PHOTON and time >= 0:
            tally[0, pixel] += 1
        if fires and recharge > 0:
            fires = rng.random() < -np.expm1(-(time - blind) / recharge)
        elif arrives and not fires:
            if is_paralyzable:
                blind_until[pixel] = max(blind, time + tau)
            elif time >= blind - twilight:
                size = push(times, owners, size, blind, KINDS * pixel + TWILIGHT)
        if fires:
            tally[1, pixel] += mean_photons(rates, pixel, blind, time, part_s, gate)
            blind_until[pixel] = time + tau
            if time >= 0:
                counts[pixel] += 1
                if kept >= 0:
                    stamps[kept], places[kept] = time, pixel
                    kept += 1
            if carriers[pixel] > 0:
                trapped = min(draw_carriers(rng, carriers[pixel]), _MOST_CARRIERS)
                tally[2, pixel] += trapped * (time >= 0)
                for _ in range(trapped):
                    release = time + draw_delay(rng, parameters.delay_s, delays, cumulative)
                    # an entry that is lost without effect need not be kept
                    if is_paralyzable or release >= blind_until[pixel] - twilight:
                        size = push(times, owners, size, release, KINDS * pixel + CARRIER)
            if parameters.is_coupled:
                avalanche = time, pixel, parameters.columns, parameters.period
                size = _push_crosstalk(rng, tables, times, owners, size, avalanche)
        if kind == PHOTON:
            # unless the dead time is extended, arrivals in it need not be drawn
            since = time if is_paralyzable else max(time, blind_until[pixel] - twilight)
            arrival = next_photon(rng, rates, pixel, since, part_s, gate)
            # photons that only extend the dead time need not enter the heap
            while is_paralyzable and arrival < min(blind_until[pixel], exposure):
                blind_until[pixel] = arrival + tau
                arrival = next_photon(rng, rates, pixel, arrival, part_s, gate)
            size = push(times, owners, size, arrival, KINDS * pixel + PHOTON)
    return size, kept


@compiled
def _push_crosstalk(rng, tables, times, owners, size, avalanche):  # type: ignore[no-untyped-def]
    """Let an avalanche light its neighbors, given its time, pixel, columns and the period."""
    time, pixel, columns, period = avalanche
    taps, strength = tables.taps, tables.strengths[pixel]
    rows, row, column = tables.strengths.size // columns, pixel // columns, pixel % columns
    place = 2 + (row % period[0]) * period[1] + column % period[1]
    for tap in range(taps.shape[0]):
        y, x = row + int(taps[tap, 0]), column + int(taps[tap, 1])
        is_inside = 0 <= y < rows and 0 <= x < columns
        if is_inside and rng.random() < taps[tap, place] * strength:
            size = push(times, owners, size, time, KINDS * (y * columns + x) + CROSSTALK)
    return size
