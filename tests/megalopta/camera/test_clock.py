"""The clocks' fit against arrivals whose law is known."""

import numpy as np
import pytest

from megalopta.camera.recorder import Clock


def fit(device_s, host_s):
    clock = Clock()
    for pair in zip(device_s, host_s, strict=True):
        clock.arrived(*pair)
    return clock.fit


def test_exact_arrivals_give_the_line():
    device_s = np.arange(100) * 0.1
    found = fit(device_s, 3 + 1.0001 * device_s)
    assert found.offset_s == pytest.approx(3, abs=1e-12)
    assert found.rate == pytest.approx(1.0001, abs=1e-12)
    assert found.error_s == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_bursts_and_stalls_do_not_move_it(seed):
    # Delays: exponential of 1 ms, every fifth frame held for up to 50 ms, and three stalls of 0.3 s.
    # In each tenth of 10 000 frames the least of 800 delays is above 25 µs once in e²⁰ times, so
    # both ends of the line are within 25 µs and its slope within 2·25 µs in 80 s.
    rng = np.random.default_rng(seed)
    device_s = np.arange(10_000) * 0.01
    delay_s = rng.exponential(1e-3, device_s.size)
    delay_s += (rng.random(device_s.size) < 0.2) * rng.uniform(0, 0.05, device_s.size)
    for start in rng.integers(0, 9970, 3):
        delay_s[start : start + 30] += np.linspace(0.3, 0, 30)
    host_s = -7 + (1 - 80e-6) * device_s + delay_s
    found = fit(device_s, host_s)
    assert found.rate == pytest.approx(1 - 80e-6, abs=1e-6)
    errors = found.offset_s + found.rate * device_s - (host_s - delay_s)
    assert np.abs(errors).max() < 50e-6
    assert found.error_s < 50e-6 + 0.05 * 10 / 100  # the last corners may be of a burst
    # Least squares follow the delays: this is what the envelope is for.
    slope, offset = np.polyfit(device_s, host_s, 1)
    assert np.abs(offset + slope * device_s - (host_s - delay_s)).min() > 50e-6


def test_a_bent_clock_takes_no_memory_and_its_error_is_told():
    # Host time grows as t + 1e-7·t²: the hull has every point, 2^14 of them.
    device_s = np.linspace(0, 100, 2**14)
    found = fit(device_s, device_s + 1e-7 * device_s**2)
    # The tangent in the middle lies below by 1e-7·(t − 50)², 1e-7·50²/3 on average.
    assert found.error_s == pytest.approx(1e-7 * 2500 / 3, rel=0.05)
