"""Mean and variance of the counts of a pixel against closed forms."""

import numpy as np
import pytest
from scipy.linalg import expm

from megalopta.sensor.effects.afterpulsing import Afterpulsing
from megalopta.sensor.effects.dead_time import DeadTime, moments
from megalopta.sensor.spad.model import AvalancheEffects
from megalopta.sensor.spad.moments import MEAN_ERROR, VARIANCE_ERROR, VARIANCE_FLOOR, pixel_moments

TAU_S = 1e-6


def effects_of(kind, start, afterpulsing):
    dead_time = DeadTime(kind=kind, dead_time_s=TAU_S * (kind != "ideal"), start=start)
    return AvalancheEffects(dead_time=dead_time, afterpulsing=afterpulsing)


def hawkes(rate, exposure_s, traps, is_stationary):
    """Exact mean and variance without dead time.

    Counts N and filled traps n are Markov. With primaries r, carriers p and releases β = 1/delay:
    n' = r·p − β(1−p)·n, N' = r + β·n, v_nn' = r(p+p²) + β(1−p+p²)·n − 2β(1−p)·v_nn,
    v_nN' = r·p − β(1−p)·n + β·v_nn − β(1−p)·v_nN, v_NN' = r + β·n + 2β·v_nN.
    """
    p, release = traps.mean_carriers, 1 / traps.delay_s
    decay, filled = release * (1 - p), release * (1 - p + p**2)
    system = np.array(
        [
            [-decay, 0, 0, 0, 0, p],
            [filled, -2 * decay, 0, 0, 0, p + p**2],
            [-decay, release, -decay, 0, 0, p],
            [release, 0, 0, 0, 0, 1],
            [release, 0, 2 * release, 0, 0, 1],
            [0, 0, 0, 0, 0, 0],
        ]
    )
    state = np.array([0, 0, 0, 0, 0, 1.0])
    if is_stationary:
        state[0] = p / decay
        state[1] = (p + p**2 + filled * state[0]) / (2 * decay)
    mean, variance = (expm(system * exposure_s) @ state)[3:5]
    return rate * mean, rate * variance


def check(stated, exact):
    (mean, variance), (exact_mean, exact_variance) = stated, exact
    np.testing.assert_allclose(mean, exact_mean, rtol=MEAN_ERROR, atol=1e-6)
    np.testing.assert_allclose(variance, exact_variance, rtol=VARIANCE_ERROR, atol=VARIANCE_FLOOR)


@pytest.mark.parametrize("start", ["live", "stationary"])
@pytest.mark.parametrize("exposure_s", [3e-6, 1e-4])
@pytest.mark.parametrize("carriers", [0.05, 0.2])
def test_afterpulsing_has_the_moments_of_a_hawkes_process(carriers, exposure_s, start):
    rates = np.geomspace(0.1, min(1e5, 5e6 * exposure_s), 31) / exposure_s  # most between nodes
    traps = Afterpulsing(mean_carriers=carriers, delay_s=2e-6)
    stated = pixel_moments(rates, exposure_s, effects_of("ideal", start, traps))
    check(stated, hawkes(rates, exposure_s, traps, start == "stationary"))


@pytest.mark.parametrize("start", ["live", "stationary"])
@pytest.mark.parametrize("kind", ["nonparalyzable", "paralyzable"])
@pytest.mark.parametrize("exposure_s", [3e-6, 3e-5])
def test_hardly_any_carriers_leave_the_moments_of_dead_time(kind, exposure_s, start):
    rates = np.geomspace(0.1 / exposure_s, 100 / TAU_S, 21)
    effects = effects_of(kind, start, Afterpulsing(mean_carriers=1e-9, delay_s=2e-6))
    stated = pixel_moments(rates, exposure_s, effects)
    check(stated, moments(rates, exposure_s, effects.dead_time))
