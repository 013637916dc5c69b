"""Event-by-event simulation of every avalanche of an exposure, in order of time.

It is exact, and used where the count distribution has no closed form: dead time with afterpulsing,
crosstalk or gating, twilight pulses, recharging, light that changes within the exposure, and event
streams. A heap holds the arrivals that may fire a pixel next (`kernel`). Without crosstalk, pixels
are independent and simulated one by one, so the heap rarely holds more than one entry.

An exposure starts live, charged and with empty traps; or stationary, by starting 20 dead times plus
the traps' memory earlier, in equilibrium without afterpulses; or where another exposure ended, so
that the array runs continuously. At r·τ = a, a non-paralyzable pixel forgets as e^(−βt/τ), β =
½·ln(1 + π²/(a + a²)). What remains is a part in e¹⁷ at a = 1, and 6 % of a disturbance by gate or
carriers at a = 5.
"""

from typing import NamedTuple

import numpy as np

from megalopta.core.arrays import Floats, Ints
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.spad import kernel
from megalopta.sensor.spad.model import AvalancheEffects


class PixelState(NamedTuple):
    """State of an array's pixels at the end of an exposure; times from that end."""

    dead_until_s: Floats
    """End of the last dead time, (N,)"""
    pending: kernel.Entries
    """Released carriers and twilight pulses, in the order of pixels"""


class SimulatedFrame(NamedTuple):
    """One exposure of an array."""

    counts: Ints
    """(rows, columns)"""
    times_s: Floats
    """Times of the counted avalanches from the start of the exposure; empty unless requested"""
    pixels: Ints
    """Flat pixel index of each"""
    state: PixelState
    """State from which `simulate_frame` continues"""


def simulate_frame(
    rng: np.random.Generator,
    rate_hz: Floats,
    exposure_s: float,
    effects: AvalancheEffects,
    *,
    maps: AvalancheMaps | None = None,
    state: PixelState | None = None,
    keep_events: bool = True,
    arrivals: tuple[Floats, Ints] | None = None,
) -> SimulatedFrame:
    """Simulate one exposure, from its own start or from the end of another one.

    Parameters
    ----------
    rate_hz : (rows, columns) or (S, rows, columns) float64
        Rate of arrivals, constant or in S equal parts of the exposure.
    maps : AvalancheMaps, optional
        Differences in dead time, afterpulsing and crosstalk; default: none.
    state : PixelState, optional
        State at the end of the previous exposure; this one follows without a gap.
    keep_events : bool
        True to return times and pixels, ordered by pixel and then time; by time with crosstalk.
    arrivals : (times_s, pixels), optional
        Photons and dark carriers that meet an open gate, in order of time, in place of a rate.
    """
    rates = rate_hz if rate_hz.ndim == 3 else rate_hz[None]
    _, rows, columns = rates.shape
    maps = maps or AvalancheMaps(*(np.ones((1, 1)) for _ in range(3)))
    parameters, tables = kernel.parameters_of(rates, exposure_s, effects, maps)
    if state is None:
        state = PixelState(np.full(rows * columns, np.nan), np.empty(0, kernel.ENTRY))
    else:
        parameters = parameters._replace(start_s=0.0)
    dead_until_s = state.dead_until_s.copy()
    given = np.empty(0), np.empty(0, np.int64)
    if arrivals is not None:
        given = np.append(arrivals[0], np.inf), np.append(arrivals[1], 0)
        parameters = parameters._replace(is_coupled=True)
    counts, events, left = kernel.run_frame(
        rng, parameters, tables, keep_events, dead_until_s, state.pending, given
    )
    left = left[np.argsort(left["owner"] // kernel.KINDS, kind="stable")]
    left["time_s"] -= exposure_s
    times_s, pixels = np.ascontiguousarray(events["time_s"]), np.ascontiguousarray(events["owner"])
    after = PixelState(dead_until_s - exposure_s, left)
    return SimulatedFrame(counts.reshape(rows, columns), times_s, pixels, after)
