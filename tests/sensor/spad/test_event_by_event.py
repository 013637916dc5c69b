"""Stated moments and draws against the plainest simulation of one event after another.

Every pair of effects that acts on avalanches, from rτ = .01 to 100 and 5 to 1000 dead times an
exposure: each number is within the stated error, plus the noise of the simulation, or is refused.
"""

from itertools import combinations

import numpy as np
import pytest

from megalopta.core.errors import UserError
from megalopta.sensor.effects.afterpulsing import Afterpulsing
from megalopta.sensor.effects.crosstalk import Crosstalk
from megalopta.sensor.effects.dead_time import DeadTime
from megalopta.sensor.effects.gating import Gate
from megalopta.sensor.spad.counts import draw_frame
from megalopta.sensor.spad.model import AvalancheEffects
from megalopta.sensor.spad.moments import MEAN_ERROR, VARIANCE_ERROR, VARIANCE_FLOOR, count_moments

from ..plainest import brute_force_events

TAU_S, DELAY_S, GATE_S, FIRED = 1e-6, 2e-6, (7.3e-6, 3.1e-6), 0.05
ALL = "nonparalyzable", "paralyzable", "twilight", "recharging", "afterpulses", "gate", "crosstalk"
PAIRS = [
    pair
    for pair in combinations(ALL, 2)
    if not {*pair} <= {"nonparalyzable", "paralyzable", "twilight", "recharging"}
    or (pair[0] == "nonparalyzable" != pair[1] and pair[1] != "paralyzable")
]
RATES = 0.01, 0.1, 0.6, 2.0, 7.0, 15.0, 33.0, 100.0
EXPOSURES = 5.0, 20.3, 200.0, 1000.0
# of 6 · 8 · 4 · 20 numbers none is farther off by chance in 10⁶ tests
SIGMAS = 6.5


def effects_of(pair):
    kind = "paralyzable" if "paralyzable" in pair else "nonparalyzable"
    if not {*pair} & {"nonparalyzable", "paralyzable", "twilight", "recharging"}:
        kind = "ideal"
    dead_time = DeadTime(
        kind=kind,
        dead_time_s=TAU_S * (kind != "ideal"),
        twilight_s=0.3 * TAU_S * ("twilight" in pair),
        recharge_s=0.5 * TAU_S * ("recharging" in pair),
    )
    return AvalancheEffects(
        dead_time=dead_time,
        afterpulsing=Afterpulsing(mean_carriers=0.1 * ("afterpulses" in pair), delay_s=DELAY_S),
        gate=Gate(period_s=GATE_S[0], width_s=GATE_S[1]) if "gate" in pair else Gate(),
        crosstalk=Crosstalk(mean_fired_neighbors=4 * FIRED * ("crosstalk" in pair)),
    )


def simulated(pair, rate_hz, exposure_s, events):
    """Rates (rows, columns), and counts (frames,) of a pixel or of the middle of 7 × 7."""
    side = 7 if "crosstalk" in pair else 1
    frames = int(np.clip(events / max(rate_hz * exposure_s, 0.5) / side**2, 60, 60_000))
    rates, rng = np.full((frames, 1, side**2), rate_hz), np.random.default_rng(1)
    counts = brute_force_events(rng, rates, exposure_s, effects_of(pair), layout=(side, side))
    return np.full((side, side), rate_hz), counts[:, 0, side**2 // 2].astype(np.float64)


def check(counts, mean, variance, case, frames=np.inf):
    """Mean and variance of simulated counts are those given; known from so many frames."""
    # with crosstalk, `counts` states five times the errors of a pixel
    worse = 5 if "crosstalk" in case[0] else 1
    size = len(counts)
    noise = (1 / size + 1 / frames) ** 0.5
    # few rare counts tell little of their own spread
    spread = max(counts.var(), variance, 3 / size)
    fourth = max(((counts - counts.mean()) ** 4).mean(), 3 * spread**2, spread)
    off = abs(counts.mean() - mean) - worse * MEAN_ERROR * mean
    assert off < SIGMAS * spread**0.5 * noise, (case, counts.mean(), mean)
    off = abs(counts.var() - variance) - max(worse * VARIANCE_ERROR * variance, VARIANCE_FLOOR)
    assert off < SIGMAS * fourth**0.5 * noise, (case, counts.var(), variance)


FEW = [("nonparalyzable", "afterpulses"), ("twilight", "gate"), ("paralyzable", "crosstalk")]


@pytest.mark.parametrize("pair", FEW, ids="-".join)
@pytest.mark.parametrize(("rates", "exposures", "events"), [(RATES[2::3], EXPOSURES[1:2], 3e5)])
def test_some_moments_are_those_of_single_events(pair, rates, exposures, events):
    compare(pair, rates, exposures, events)


@pytest.mark.slow
@pytest.mark.parametrize("pair", PAIRS, ids="-".join)
def test_moments_and_draws_are_those_of_single_events(pair):
    # all pixels of an array are looked through for every event
    events, exposures = (1e6, EXPOSURES[1:2]) if "crosstalk" in pair else (4e6, EXPOSURES)
    compare(pair, RATES, exposures, events)


def compare(pair, rates, exposures, events):
    effects, stated = effects_of(pair), 0
    for rate in rates:
        for exposure in exposures:
            case = pair, rate, exposure
            exposure_s = exposure * TAU_S
            rates_hz, counts = simulated(pair, rate / TAU_S, exposure_s, events)
            middle = len(rates_hz) // 2
            if middle == 0:
                many_hz = np.full((1, len(counts)), rate / TAU_S)
                drawn = draw_frame(np.random.default_rng(2), many_hz, exposure_s, effects)
                check(drawn.ravel(), counts.mean(), counts.var(), case, len(counts))
            try:
                moments = count_moments(rates_hz, exposure_s, effects)
            except UserError:
                continue
            check(counts, *(float(part[middle, middle]) for part in moments), case)
            stated += 1
    assert stated >= len(exposures), "refused nearly everywhere"
