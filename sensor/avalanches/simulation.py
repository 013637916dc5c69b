"""Every avalanche of an exposure, one after the other, in the order of time.

The exact simulation where no law of the counts is known: dead time together with afterpulsing,
crosstalk or gating, and every stream of events. A heap holds what may fire a pixel next: its next
photon (or dark carrier), released carriers and crosstalk light. Without crosstalk the pixels do not
know of each other and are simulated one by one, so that the heap holds hardly more than one entry.

An avalanche is counted when its pixel is live and the gate open. A photon or crosstalk light in the
dead time is lost and extends a paralyzable one; a carrier in the dead time is lost without effect.

Start: live, with empty traps; or stationary, by starting 20 dead times and the traps' memory
earlier from a dead time in equilibrium without afterpulses. At r·τ = a a non-paralyzable pixel
forgets as e^(−βt/τ), β = ½·ln(1 + π²/(a + a²)): but for a part in e¹⁷ at a = 1, and for 6 % of what
gate or carriers disturb at a = 5.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from megalopta.sensor.effects import (
    Afterpulsing,
    Crosstalk,
    DeadTime,
    Gate,
    draw_carriers,
    draw_delay,
    is_open,
    neighborhood,
    open_time,
    wall_time,
)

_PHOTON, _CARRIER, _CROSSTALK = 0, 1, 2
# Entries that one avalanche may add. More carriers than 32 come once in 10³⁶ avalanches.
_MOST_CARRIERS = 32
_ROOM = _MOST_CARRIERS + 9

Floats = NDArray[np.float64]


class AvalancheEffects(NamedTuple):
    """What decides which avalanches occur, by the names of the fields of `Sensor`; hashable."""

    dead_time: DeadTime = DeadTime()
    afterpulsing: Afterpulsing = Afterpulsing()
    gate: Gate = Gate()
    crosstalk: Crosstalk = Crosstalk()

    @property
    def on(self) -> frozenset[str]:
        """Names of those that are on."""
        return frozenset(name for name in self._fields if getattr(self, name).is_on)

    @property
    def memory_s(self) -> float:
        """Time after which a pixel has forgotten its past, dead times apart, s."""
        return sum(effect.memory_s for effect in self if effect.is_on)


class _Parameters(NamedTuple):
    exposure_s: float
    start_s: float
    dead_time_s: float
    is_paralyzable: bool
    is_stationary: bool
    mean_carriers: float
    delay_s: float
    period_s: float
    width_s: float
    phase_s: float


class _Tables(NamedTuple):
    """The parameters that are arrays: numba counts a reference to each wherever they are passed."""

    delays_s: Floats
    cumulative: Floats
    neighborhood: Floats


def simulate_counts(
    rng: np.random.Generator, rate_hz: Floats, exposure_s: float, effects: AvalancheEffects
) -> NDArray[np.int64]:
    """Counts of one exposure of a (rows, columns) frame of arrival rates."""
    counts: NDArray[np.int64]
    counts, _, _ = _simulate(
        rng, rate_hz, *_parameters(exposure_s, effects), effects.crosstalk.is_on, False
    )
    return counts


def simulate_events(
    rng: np.random.Generator, rate_hz: Floats, exposure_s: float, effects: AvalancheEffects
) -> tuple[Floats, NDArray[np.int64]]:
    """Times, s, from the start of the exposure, and flat pixel indices of the counted avalanches.

    Ordered by pixel and then time, or with crosstalk by time.
    """
    _, times, pixels = _simulate(
        rng, rate_hz, *_parameters(exposure_s, effects), effects.crosstalk.is_on, True
    )
    return times, pixels


def _parameters(exposure_s: float, effects: AvalancheEffects) -> tuple[_Parameters, _Tables]:
    dead_time, afterpulsing, gate = effects.dead_time, effects.afterpulsing, effects.gate
    is_stationary = dead_time.start == "stationary"
    dead_time_s = 0.0 if dead_time.kind == "ideal" else dead_time.dead_time_s
    parameters = _Parameters(
        exposure_s,
        -_memory_s(dead_time_s, effects) if is_stationary else 0.0,
        dead_time_s,
        dead_time.kind == "paralyzable",
        is_stationary,
        afterpulsing.mean_carriers,
        afterpulsing.delay_s,
        gate.period_s or 0.0,
        gate.width_s or 0.0,
        gate.phase_s,
    )
    tables = _Tables(
        np.array(afterpulsing.table_delays_s, np.float64),
        np.array(afterpulsing.table_cumulative, np.float64),
        neighborhood(effects.crosstalk),
    )
    return parameters, tables


def _memory_s(dead_time_s: float, effects: AvalancheEffects) -> float:
    return effects.memory_s + 20 * dead_time_s * bool(effects.on - {"dead_time"})


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _simulate(
    rng: np.random.Generator,
    rate_hz: Floats,
    parameters: _Parameters,
    tables: _Tables,
    is_coupled: bool,
    keep_events: bool,
) -> tuple[NDArray[np.int64], Floats, NDArray[np.int64]]:
    rates = rate_hz.ravel()
    counts = np.zeros(rates.size, np.int64)
    stamps, places = np.empty(64), np.empty(64, np.int64)
    kept = 0 if keep_events else -1
    block = rates.size if is_coupled else 1
    columns = rate_hz.shape[1] if is_coupled else 1
    times, owners = np.empty(block + _ROOM), np.empty(block + _ROOM, np.int64)
    blind_until = np.empty(block)
    for first in range(0, rates.size, block):
        part = rates[first : first + block]
        tally = counts[first : first + block]
        size = _start(rng, part, parameters, blind_until, times, owners)
        while size > 0 and times[0] < parameters.exposure_s:
            # arrays are made longer here, as numba counts references where they may change
            if size + _ROOM > times.size:
                times, owners = _longer(times), _longer(owners)
            if kept == stamps.size:
                stamps, places = _longer(stamps), _longer(places)
            size, kept = _run(
                rng, part, parameters, tables, columns, tally, blind_until, times, owners, size,
                stamps, places, kept, first,
            )  # fmt: skip
    return counts.reshape(rate_hz.shape), stamps[: max(kept, 0)], places[: max(kept, 0)]


@njit(cache=True, nogil=True, error_model="numpy")
def _start(rng, rates, parameters, blind_until, times, owners):  # type: ignore[no-untyped-def]
    """Fill the heap with the first arrival of every pixel and return its size."""
    gate = parameters.period_s, parameters.width_s, parameters.phase_s
    size = 0
    for pixel in range(rates.size):
        blind_until[pixel] = _first_blind_until(rng, rates[pixel], parameters)
        since = parameters.start_s if parameters.is_paralyzable else blind_until[pixel]
        if rates[pixel] > 0:
            wait = rng.standard_exponential() / rates[pixel]
            arrival = _after(since, wait, gate)
            size = _push(times, owners, size, arrival, 3 * pixel + _PHOTON)
    return size


@njit(cache=True, nogil=True, error_model="numpy")
def _run(  # type: ignore[no-untyped-def]
    rng, rates, parameters, tables, columns, counts, blind_until, times, owners, size,
    stamps, places, kept, first,
):  # fmt: skip
    """Go on to the end of the exposure, or until an array is too short; return size and kept.

    The size of the heap is 0 at the end. `kept` below 0 keeps no events.
    """
    tau, exposure = parameters.dead_time_s, parameters.exposure_s
    is_paralyzable, mean_carriers = parameters.is_paralyzable, parameters.mean_carriers
    delay_s, (delays, cumulative, neighborhood) = parameters.delay_s, tables
    gate = parameters.period_s, parameters.width_s, parameters.phase_s
    while size > 0 and times[0] < exposure:
        if size + _ROOM > times.size or kept == stamps.size:
            return size, kept
        time, pixel, kind = times[0], owners[0] // 3, owners[0] % 3
        size = _pop(times, owners, size)
        is_live = time >= blind_until[pixel]
        if is_paralyzable and kind != _CARRIER:
            blind_until[pixel] = max(blind_until[pixel], time + tau)
        if is_live and (kind == _PHOTON or is_open(time, *gate)):
            blind_until[pixel] = time + tau
            if time >= 0:
                counts[pixel] += 1
                if kept >= 0:
                    stamps[kept], places[kept] = time, first + pixel
                    kept += 1
            if mean_carriers > 0:
                for _ in range(min(draw_carriers(rng, mean_carriers), _MOST_CARRIERS)):
                    release = time + draw_delay(rng, delay_s, delays, cumulative)
                    if release >= blind_until[pixel]:
                        size = _push(times, owners, size, release, 3 * pixel + _CARRIER)
            if rates.size > 1:
                size = _push_crosstalk(
                    rng, times, owners, size, time, pixel, rates.size, columns, neighborhood
                )
        if kind == _PHOTON:
            # where the dead time is not extended, arrivals in it need not be drawn
            since = time if is_paralyzable else blind_until[pixel]
            wait = rng.standard_exponential() / rates[pixel]
            arrival = _after(since, wait, gate)
            # photons that only extend the dead time need not go through the heap
            while is_paralyzable and arrival < min(blind_until[pixel], exposure):
                blind_until[pixel] = arrival + tau
                wait = rng.standard_exponential() / rates[pixel]
                arrival = _after(arrival, wait, gate)
            size = _push(times, owners, size, arrival, 3 * pixel + _PHOTON)
    return 0, kept


@njit(cache=True, nogil=True, error_model="numpy")
def _first_blind_until(rng, rate, parameters):  # type: ignore[no-untyped-def]
    """End of the dead time that a pixel starts in."""
    start, tau = parameters.start_s, parameters.dead_time_s
    if not parameters.is_stationary or tau == 0 or rate == 0:
        return start
    if parameters.is_paralyzable:
        return start + max(tau - rng.standard_exponential() / rate, 0.0)
    is_dead = rng.random() * (1 + rate * tau) < rate * tau
    return start + tau * rng.random() if is_dead else start


@njit(cache=True, nogil=True, error_model="numpy")
def _after(since, wait, gate):  # type: ignore[no-untyped-def]
    """Time at which the gate has been open for so long."""
    if gate[0] == 0:
        return since + wait
    return wall_time(open_time(since, *gate) + wait, *gate)


@njit(cache=True, nogil=True, error_model="numpy")
def _push_crosstalk(  # type: ignore[no-untyped-def]
    rng, times, owners, size, time, pixel, pixels, columns, neighborhood
):
    for down in range(-1, 2):
        for right in range(-1, 2):
            weight = neighborhood[1 + down, 1 + right]
            row, column = pixel // columns + down, pixel % columns + right
            is_inside = 0 <= row < pixels // columns and 0 <= column < columns
            if is_inside and weight > 0 and rng.random() < weight:
                neighbor = row * columns + column
                size = _push(times, owners, size, time, 3 * neighbor + _CROSSTALK)
    return size


@njit(cache=True, nogil=True, error_model="numpy")
def _push(times, owners, size, time, owner):  # type: ignore[no-untyped-def]
    """Add to the heap and return its new size."""
    place = size
    while place > 0 and times[(place - 1) // 2] > time:
        parent = (place - 1) // 2
        times[place], owners[place] = times[parent], owners[parent]
        place = parent
    times[place], owners[place] = time, owner
    return size + 1


@njit(cache=True, nogil=True, error_model="numpy")
def _pop(times, owners, size):  # type: ignore[no-untyped-def]
    """Remove the first of the heap and return its new size."""
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


@njit(cache=True, nogil=True, error_model="numpy")
def _longer(values):  # type: ignore[no-untyped-def]
    longer = np.empty(2 * values.size + _ROOM, values.dtype)
    longer[: values.size] = values
    return longer
