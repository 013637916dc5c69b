"""Mean and variance of the counts of a pixel: closed forms, and tables on disk."""

import importlib

import numpy as np
import pytest
from scipy.linalg import expm

from megalopta.sensor.effects.afterpulsing import Afterpulsing
from megalopta.sensor.effects.dead_time import DeadTime, moments
from megalopta.sensor.spad import moments as own
from megalopta.sensor.spad.model import AvalancheEffects
from megalopta.sensor.spad.moments import pixel_moments

TAU_S = 1e-6
AFTERPULSING = Afterpulsing(mean_carriers=0.2, delay_s=2e-6)


def effects_of(kind, start, afterpulsing):
    dead_time = DeadTime(kind=kind, dead_time_s=TAU_S * (kind != "ideal"), start=start)
    return AvalancheEffects(dead_time=dead_time, afterpulsing=afterpulsing)


def slow(*values):
    return pytest.param(*values, marks=pytest.mark.slow)


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


def check(found, exact, times=1):
    """Mean within .1 % or .003 standard deviations, variance within 1 %; the streams are fixed."""
    (mean, variance), (exact_mean, exact_variance) = found, exact
    off = np.abs(mean - exact_mean)
    assert np.all(
        (off < times * own.MEAN_ERROR * exact_mean) | (off < times * 3e-3 * np.sqrt(exact_variance))
    )
    np.testing.assert_allclose(variance, exact_variance, rtol=times * own.VARIANCE_ERROR)


@pytest.mark.parametrize("start", ["live", slow("stationary")])
@pytest.mark.parametrize("exposure_s", [3e-6, slow(1e-4), slow(1e-3)])
@pytest.mark.parametrize("carriers", [0.05, 0.2])
def test_afterpulsing_has_the_moments_of_a_hawkes_process(carriers, exposure_s, start):
    rates = np.geomspace(0.1, min(1e5, 5e6 * exposure_s), 31) / exposure_s  # most between nodes
    traps = Afterpulsing(mean_carriers=carriers, delay_s=2e-6)
    found = pixel_moments(rates, exposure_s, effects_of("ideal", start, traps))
    check(found, hawkes(rates, exposure_s, traps, start == "stationary"))


@pytest.mark.parametrize("start", ["live", "stationary"])
@pytest.mark.parametrize("kind", ["nonparalyzable", "paralyzable"])
@pytest.mark.parametrize("exposure_s", [3e-6, slow(1e-4), slow(1e-3)])
def test_hardly_any_carriers_leave_the_moments_of_dead_time(kind, exposure_s, start):
    rates = np.geomspace(0.1 / exposure_s, 2 / TAU_S, 21)
    effects = effects_of(kind, start, Afterpulsing(mean_carriers=1e-9, delay_s=2e-6))
    found = pixel_moments(rates, exposure_s, effects)
    times = 2 if kind == "paralyzable" else 1
    check(found, moments(rates, exposure_s, effects.dead_time), times)


@pytest.fixture
def after_a_start(tmp_path, monkeypatch):
    """Moments as a program finds them that has just started, and how many it simulated."""
    monkeypatch.setattr("megalopta.core.folders.user_cache_path", lambda *_, **__: tmp_path)
    effects = effects_of("nonparalyzable", "live", AFTERPULSING)

    def start():
        fresh, simulated = importlib.reload(own), []  # nothing in memory
        monkeypatch.setattr(fresh, "_BUDGET_NS", 1e5)
        simulate = fresh.simulate_frame
        monkeypatch.setattr(
            fresh, "simulate_frame", lambda *a, **k: simulated.append(a) or simulate(*a, **k)
        )
        return np.array(fresh.pixel_moments(np.array([1e5]), 1e-4, effects)), len(simulated)

    return start


def test_a_table_is_made_once_and_again_when_damaged(tmp_path, after_a_start):
    made, simulated = after_a_start()
    assert simulated > 0
    read, simulated = after_a_start()
    assert simulated == 0
    np.testing.assert_array_equal(read, made)
    (file,) = (tmp_path / "moments").glob("*.npz")
    whole = file.read_bytes()
    for damaged in (whole[: len(whole) // 2], whole[:-300] + bytes(300), b""):
        file.write_bytes(damaged)
        again, simulated = after_a_start()
        assert simulated > 0
        np.testing.assert_array_equal(again, made)


def test_without_a_folder_to_write_to_the_numbers_are_the_same(tmp_path, after_a_start):
    (tmp_path / "moments").write_text("a file is in the way")
    nowhere, simulated = after_a_start()
    assert simulated > 0
    (tmp_path / "moments").unlink()
    np.testing.assert_array_equal(after_a_start()[0], nowhere)
