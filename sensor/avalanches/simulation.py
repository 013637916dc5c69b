"""Every avalanche of an exposure, one after the other, in the order of time.

The exact simulation where no law of the counts is known: dead time together with afterpulsing,
crosstalk or gating, twilight pulses, recharging, light that changes within the exposure, and every
stream of events. A heap holds what may fire a pixel next (`kernel`). Without crosstalk the pixels
do not know of each other and are simulated one by one, so that the heap holds hardly more than one
entry.

Start: live, charged, with empty traps; stationary, by starting 20 dead times and the traps' memory
earlier from a dead time in equilibrium without afterpulses; or where another exposure ended, so
that an array runs freely. At r·τ = a a non-paralyzable pixel forgets as e^(−βt/τ), β = ½·ln(1 +
π²/(a + a²)): but for a part in e¹⁷ at a = 1, and for 6 % of what gate or carriers disturb at a = 5.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from megalopta.core.arrays import Floats, Ints
from megalopta.sensor.avalanches.kernel import KINDS, Before, parameters_of, run_frame
from megalopta.sensor.effects.base import AvalancheMaps
from megalopta.sensor.effects.fields import AvalancheEffects


class PixelState(NamedTuple):
    """What the pixels of an array remember at the end of an exposure; times from that end."""

    blind_until_s: Floats
    """End of the last dead time, (N,)"""
    pending_s: Floats
    """When trapped carriers will be released and twilight pulses come, (M,)"""
    owners: Ints
    """Pixel and kind of each of these, (M,), in the order of pixels"""


class SimulatedFrame(NamedTuple):
    """One exposure of an array."""

    counts: Ints
    """(rows, columns)"""
    tally: Floats
    """Photons and dark carriers that met a live pixel, their mean given the time that it was live,
    and carriers trapped, (3, N)"""
    times_s: Floats
    """Of the counted avalanches, from the start of the exposure; empty unless asked for"""
    pixels: Ints
    """Flat index of the pixel of each"""
    state: PixelState
    """From which `simulate_frame` goes on"""


def simulate_frame(
    rng: np.random.Generator,
    rate_hz: Floats,
    exposure_s: float,
    effects: AvalancheEffects,
    *,
    maps: AvalancheMaps | None = None,
    state: PixelState | None = None,
    keep_events: bool = True,
) -> SimulatedFrame:
    """Simulate one exposure, from a start of its own or from where another one ended.

    Parameters
    ----------
    rng : numpy.random.Generator
    rate_hz : (rows, columns) or (S, rows, columns) float64
        Rate of arrivals, constant or in S equal parts of the exposure.
    exposure_s : float
    effects : AvalancheEffects
    maps : AvalancheMaps, optional
        How pixels differ in dead time, afterpulsing and crosstalk; by default not at all.
    state : PixelState, optional
        Of the exposure before; it follows without a gap.
    keep_events : bool
        Whether times and pixels are wanted: ordered by pixel and then time, or with crosstalk by
        time.
    """
    rates = rate_hz if rate_hz.ndim == 3 else rate_hz[None]
    _, rows, columns = rates.shape
    maps = maps or AvalancheMaps.alike((rows, columns))
    parameters, tables = parameters_of(rates, exposure_s, effects, maps)
    if state is None:
        before = Before(False, np.empty(rows * columns), np.empty(0), np.empty(0, np.int64))
    else:
        parameters = parameters._replace(start_s=0.0)
        before = Before(True, state.blind_until_s.copy(), state.pending_s, state.owners)
    counts, tally, events, left = run_frame(rng, parameters, tables, keep_events, before)
    order = np.argsort(left[1] // KINDS, kind="stable")
    after = PixelState(before.blind_until - exposure_s, left[0][order] - exposure_s, left[1][order])
    times, pixels = events
    return SimulatedFrame(counts.reshape(rows, columns), tally, times, pixels, after)


@dataclass
class FreeRunning:
    """An array that is not reset between exposures, which follow on each other without a gap.

    `FreeRunning()` has not begun.

    Attributes
    ----------
    state : PixelState, optional
        What its pixels remember; replaced by every exposure.
    """

    state: PixelState | None = None

    def expose(
        self,
        rng: np.random.Generator,
        rate_hz: Floats,
        exposure_s: float,
        effects: AvalancheEffects,
        maps: AvalancheMaps | None = None,
        *,
        keep_events: bool = True,
    ) -> SimulatedFrame:
        """Simulate the next exposure; parameters as for `simulate_frame`.

        Raises
        ------
        ValueError
            When the array had another number of pixels before.
        """
        rows, columns = rate_hz.shape[-2:]
        if self.state is not None and self.state.blind_until_s.size != rows * columns:
            raise ValueError(
                f"free_running: the array had {self.state.blind_until_s.size} pixels before and "
                f"has {rows} × {columns} now; give the same frames, or begin anew"
            )
        frame = simulate_frame(
            rng, rate_hz, exposure_s, effects, maps=maps, state=self.state, keep_events=keep_events
        )
        self.state = frame.state
        return frame


def running_array(
    free_running: bool | FreeRunning, effects: AvalancheEffects
) -> FreeRunning | None:
    """The array that goes on, a new one for True; none where frames do not depend on each other."""
    if not free_running or not effects.remembers:
        return None
    return FreeRunning() if free_running is True else free_running


def simulate_counts(
    rng: np.random.Generator,
    rate_hz: Floats,
    exposure_s: float,
    effects: AvalancheEffects,
    maps: AvalancheMaps | None = None,
) -> Ints:
    """Counts (rows, columns) of one exposure; parameters as for `simulate_frame`."""
    return simulate_frame(rng, rate_hz, exposure_s, effects, maps=maps, keep_events=False).counts
