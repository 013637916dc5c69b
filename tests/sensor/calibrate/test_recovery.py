"""Recovery of an array of counters: what was made is found, of counts of another simulation."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from megalopta.camera.calibration import primary
from megalopta.sensor.calibrate.counts import calibrate_counts, summed
from megalopta.sensor.calibrate.recovery import Curves, fit_recovery
from megalopta.sensor.effects.dead_time import DeadTime, moments

BENCHMARK = Path(__file__).parents[3] / "benchmarks/bench_calibration.py"
simulated = runpy.run_path(str(BENCHMARK))["simulated"]
LEVELS = ((2e-3, 0.0), (1e-2, 0.0), (1e-4, 5e4), (1e-4, 5e5), (1e-4, 2e6), (1e-4, 3e6))
FRAMES = 300
KINDS = ("nonparalyzable", "paralyzable")


def curves_of(means_and_variances):
    """Curves of pixels from their mean and variance at each level."""
    mean, variance = np.array(means_and_variances).transpose(1, 0, 2)
    exposure_s, light_hz = np.transpose(LEVELS)
    return Curves(mean, variance, np.full(mean.shape, float(FRAMES)), exposure_s, light_hz)


def pixels(side, seed=1):
    """Dark counts (Hz) and efficiency of each pixel."""
    rng = np.random.default_rng(seed)
    return rng.uniform(50, 150, side**2), rng.uniform(0.16, 0.24, side**2)


def recorded(side, recovery, traps=(0.0, 1.0), levels=LEVELS):
    """Recordings of a simulated array; recovery is (s, s, s, is paralyzable)."""
    (dark_hz, efficiency), rng = pixels(side), np.random.default_rng(2)
    arrays = np.array(recovery, np.float64), np.array(traps), np.zeros((2, 3, 3))
    for exposure_s, light_hz in levels:
        rates_hz = (dark_hz + efficiency * light_hz).reshape(side, side)
        counts = simulated(rng, rates_hz, FRAMES, exposure_s, *arrays)
        yield summed(counts, exposure_s, light_hz, is_binary=False)


def curves(*simulation):
    """Curves of a simulated array, as `recorded`."""
    statistics = [recording.of for recording in recorded(*simulation)]
    return curves_of([(of.mean.ravel(), of.variance.ravel()) for of in statistics])


@pytest.mark.parametrize("kind", KINDS)
def test_kind_and_dead_time_follow_from_means_and_variances(kind):
    (dark_hz, efficiency), rng = pixels(16), np.random.default_rng(3)
    levels = []
    for exposure_s, light_hz in LEVELS:
        rates_hz = dark_hz + efficiency * light_hz
        mean, variance = moments(rates_hz, exposure_s, DeadTime(kind=kind, dead_time_s=1e-6))
        seen = mean + rng.standard_normal(mean.shape) * np.sqrt(variance / FRAMES)
        levels.append((seen, variance * rng.chisquare(FRAMES - 1, mean.shape) / (FRAMES - 1)))
    of = fit_recovery(curves_of(levels), 0.0)
    assert of.fit.recovery.kind == kind and of.is_kind_clear
    assert of.fit.misfit.p > 1e-6
    # 5 standard errors: a false alarm in 1.7e6
    assert abs(of.fit.recovery.dead_s - 1e-6) < 5 * of.error_s < 0.02e-6


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("delay_s", [1e-6, 1e-5])
def test_afterpulses_next_to_dead_time(kind, delay_s):
    of = fit_recovery(curves(24, (1e-6, 0, 0, kind == "paralyzable"), (0.04, delay_s)), 0.02)
    recovery = of.fit.recovery
    assert recovery.kind == kind and of.is_kind_clear and of.fit.misfit.p > 1e-6
    # 5 standard errors: a false alarm in 1.7e6
    assert abs(recovery.dead_s - 1e-6) < 5 * of.error_s < 0.06e-6
    fired = 0.04 * np.exp(-1e-6 / delay_s)
    assert abs(recovery.fired - fired) < 5 * of.fired_error < 0.02
    low_s, high_s = of.delays_s
    # about 5 standard errors, of 95 % CI
    assert low_s / 2.5 < delay_s < 2.5 * high_s


@pytest.mark.slow
@pytest.mark.parametrize("traps", [(0.0, 1.0), (0.04, 2e-6)])
@pytest.mark.parametrize("lights_hz", [(5e4, 5e5, 2e6, 1e7), (5e4, 5e5, 1e7, 2e7)])
def test_light_beyond_the_maximum_of_a_paralyzable_curve(lights_hz, traps):
    levels = *LEVELS[:2], *((1e-4, light_hz) for light_hz in lights_hz)
    device = calibrate_counts([*recorded(16, (1e-6, 0, 0, 1), traps, levels)])
    assert device.dead_time.recovery.kind == "paralyzable" and device.dead_time.is_kind_clear
    # 5 standard errors: a false alarm in 1.7e6
    assert abs(device.dead_time.recovery.dead_s - 1e-6) < 5 * device.dead_time.error_s < 0.06e-6
    efficiency, truth = primary(device.efficiency, device.kernel), pixels(16)[1].reshape(16, 16)
    # 256 pixels of which 95 % are covered: 5 binomial errors
    covered = np.mean((efficiency.low <= truth) & (truth <= efficiency.high))
    assert covered > 0.95 - 5 * (0.95 * 0.05 / 256) ** 0.5


@pytest.mark.slow
@pytest.mark.parametrize(("name", "recovery"), [
    ("recharge_s", (1e-6, 0, 5e-7, 0)), ("twilight_s", (1e-6, 3e-7, 0, 0)),
])  # fmt: skip
def test_a_slow_recovery_is_fitted_where_frames_show_it(name, recovery):
    of = fit_recovery(curves(24, recovery), 0.0)
    assert of.fit.names == ("dead_s", name) and not of.slow_limits
    assert abs(of.fit.recovery.dead_s - 1e-6) < 5 * of.error_s < 0.15e-6
    slow_s = getattr(of.fit.recovery, name)
    assert abs(slow_s - max(recovery[1:3])) < 5 * of.fit.error(name) < 0.3e-6


@pytest.mark.slow
def test_what_frames_do_not_exclude_is_limited():
    limits = fit_recovery(curves(24, (1e-6, 0, 0, 0)), 0.0).slow_limits
    assert 0 < limits["recharge_s"] < 0.5e-6
    assert 0 < limits["twilight_s"] < 0.5e-6
