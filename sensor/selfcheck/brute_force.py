"""Counts of one pixel by the plainest possible simulation, to hold the others against.

Photon after photon, and of the released carriers whichever comes first, found by looking at all of
them; nothing is skipped, no law is used. A closed gate drops what arrives. A stationary start is a
live one a long time earlier, long enough for dead times to lose their rhythm. Slow on purpose, and
shares no code with what it checks.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from megalopta.sensor.avalanches import AvalancheEffects

_MOST_CARRIERS = 4096
_DEAD_TIMES_TO_FORGET = 300

Floats = NDArray[np.float64]


def brute_force_counts(
    rng: np.random.Generator,
    rate_hz: float,
    exposure_s: float,
    effects: AvalancheEffects,
    exposures: int,
) -> NDArray[np.int64]:
    """Counts of so many exposures of one pixel; no crosstalk."""
    dead_time, traps, gate, _ = effects
    tau = 0.0 if dead_time.kind == "ideal" else dead_time.dead_time_s
    counts: NDArray[np.int64] = _simulate(
        rng,
        (rate_hz, exposure_s, run_up_s(effects), tau),
        dead_time.kind == "paralyzable",
        (traps.mean_carriers, traps.delay_s),
        (np.array(traps.table_delays_s), np.array(traps.table_cumulative)),
        (gate.period_s or 0.0, gate.width_s or 0.0, gate.phase_s),
        exposures,
    )
    return counts


def run_up_s(effects: AvalancheEffects) -> float:
    """Time simulated before the exposure, s."""
    dead_time, traps = effects.dead_time, effects.afterpulsing
    if dead_time.start == "live":
        return 0.0
    tau = 0.0 if dead_time.kind == "ideal" else dead_time.dead_time_s
    return _DEAD_TIMES_TO_FORGET * tau + traps.memory_s * traps.is_on


@njit(cache=True, nogil=True)
def _simulate(rng, times, extends, traps, table, gate, exposures):  # type: ignore[no-untyped-def]
    rate, exposure, run_up, tau = times
    counts = np.zeros(exposures, np.int64)
    releases = np.empty(_MOST_CARRIERS)
    for index in range(exposures):
        trapped, blind_until = 0, -run_up
        photon = -run_up + rng.exponential(1 / rate)
        while True:
            first = -1
            now = photon
            for carrier in range(trapped):
                if releases[carrier] < now:
                    first, now = carrier, releases[carrier]
            if now > exposure:
                break
            if first < 0:
                photon = now + rng.exponential(1 / rate)
            else:
                trapped -= 1
                releases[first] = releases[trapped]
            if gate[0] > 0 and (now - gate[2]) % gate[0] >= gate[1]:
                continue
            avalanche = now >= blind_until
            if avalanche or (extends and first < 0):
                blind_until = now + tau
            if not avalanche:
                continue
            counts[index] += now >= 0
            filled = rng.poisson(traps[0]) if traps[0] > 0 else 0
            for _ in range(filled):
                if table[0].size > 0:
                    delay = np.interp(rng.random(), table[1], table[0])
                else:
                    delay = rng.exponential(traps[1])
                releases[trapped] = now + delay
                trapped += 1
    return counts
