import numpy as np
import pytest

from megalopta.sensor.avalanches.moments import pixel_moments
from megalopta.sensor.effects import gated_paralyzable, paralyzable
from megalopta.sensor.effects.afterpulsing import Afterpulsing
from megalopta.sensor.effects.dead_time import DeadTime, moments
from megalopta.sensor.effects.fields import AvalancheEffects
from megalopta.sensor.effects.gating import Gate
from megalopta.sensor.sampling.streams import generator
from megalopta.verification.brute_force import brute_force_counts

TAU_S = 1e-6
AFTERPULSING = Afterpulsing(mean_carriers=0.2, delay_s=2e-6)
GATE = Gate(period_s=7e-6, width_s=3e-6, phase_s=5e-6)
UNGATED = Gate()
EXPOSURES = 4_000
# longer and shorter than the dead time; the last opens with the exposure
GATES = [
    GATE,
    Gate(period_s=0.3e-6, width_s=0.1e-6, phase_s=0.2e-6),
    Gate(period_s=1.3e-6, width_s=0.9e-6),
]


def effects_of(kind, start, afterpulsing, gate=UNGATED):
    dead_time = DeadTime(kind=kind, dead_time_s=TAU_S * (kind != "ideal"), start=start)
    return AvalancheEffects(dead_time=dead_time, afterpulsing=afterpulsing, gate=gate)


def slow(*values):
    return pytest.param(*values, marks=pytest.mark.slow)


def z_scores(counts, mean, variance):
    squares = (counts - counts.mean()) ** 2
    return (
        (counts.mean() - mean) / (counts.std() / counts.size**0.5),
        (squares.mean() - variance) / (squares.std() / counts.size**0.5),
    )


@pytest.mark.slow
@pytest.mark.parametrize("exposure_s", [3.3e-6, 20e-6])
@pytest.mark.parametrize("start", ["live", "stationary"])
@pytest.mark.parametrize("gate", GATES, ids=["long", "short", "open first"])
def test_gated_paralyzable_moments_are_those_of_brute_force(gate, start, exposure_s):
    effects = effects_of("paralyzable", start, Afterpulsing(), gate)
    rates = np.array([2e5, 1e6, 6e6])
    expected = zip(rates, *pixel_moments(rates, exposure_s, effects), strict=True)
    for rate, mean, variance in expected:
        rng = generator(3, start, f"{exposure_s} {rate}")
        counts = brute_force_counts(rng, rate, exposure_s, effects, EXPOSURES)
        assert np.abs(z_scores(counts, mean, variance)).max() < 5  # false alarm 1e-6


@pytest.mark.parametrize("is_stationary", [False, True])
@pytest.mark.parametrize("exposure_s", [0.3e-6, 5e-6, 37e-6, 1e-3])
def test_gate_that_never_closes_leaves_the_closed_form(exposure_s, is_stationary):
    rates = np.array([1e4, 1e6, 5e6])
    window = 7e-6, 7e-6, 5e-6
    gated = gated_paralyzable.moments(rates, exposure_s, TAU_S, window, is_stationary)
    closed = paralyzable.moments(rates * exposure_s, TAU_S / exposure_s, is_stationary)
    # the closed variance is a difference of squares of up to 1e3 counts
    np.testing.assert_allclose(gated, closed, rtol=1e-9)


@pytest.mark.parametrize("kind", ["nonparalyzable", "paralyzable"])
@pytest.mark.parametrize("arrivals", [slow(0.3), 30.0, slow(3e3), slow(1e6)])
def test_simulated_moments_without_carriers_to_speak_of_are_the_closed_ones(kind, arrivals):
    hardly_any = Afterpulsing(mean_carriers=1e-9, delay_s=2e-6)
    effects = effects_of(kind, "live", hardly_any)
    rate = np.array([1.1e6])  # between two nodes
    simulated = pixel_moments(rate, arrivals / rate[0], effects)
    closed = moments(rate, arrivals / rate[0], effects.dead_time)
    # about twice the standard errors stated; the streams are fixed
    np.testing.assert_allclose(simulated[0], closed[0], rtol=5e-3)
    np.testing.assert_allclose(simulated[1], closed[1], rtol=3e-2)


@pytest.mark.parametrize("start", ["live", "stationary"])
@pytest.mark.parametrize(
    ("kind", "rate", "exposure_s", "traps", "gate"),
    [
        slow("paralyzable", 3.3e6, 300e-6, AFTERPULSING, Gate()),
        ("paralyzable", 1.3e6, 50e-6, AFTERPULSING, GATE),
        ("nonparalyzable", 1.3e6, 50e-6, Afterpulsing(), GATE),
        slow("nonparalyzable", 3.3e6, 400e-6, AFTERPULSING, Gate()),
        slow("ideal", 3.3e6, 400e-6, AFTERPULSING, GATE),
    ],
)
def test_combined_effects_have_the_moments_of_brute_force(
    kind, rate, exposure_s, traps, gate, start
):
    effects = effects_of(kind, start, traps, gate)
    mean, variance = (each[0] for each in pixel_moments(np.array([rate]), exposure_s, effects))
    counts = brute_force_counts(generator(4), rate, exposure_s, effects, EXPOSURES)
    squares = (counts - counts.mean()) ** 2
    # five standard errors of brute force (false alarm 6e-7) and those stated of the interpolation
    error = 5 * counts.std() / counts.size**0.5
    assert counts.mean() == pytest.approx(mean, abs=error + 3e-3 * mean)
    error = 5 * squares.std() / counts.size**0.5
    assert squares.mean() == pytest.approx(variance, abs=error + 1.5e-2 * variance)
