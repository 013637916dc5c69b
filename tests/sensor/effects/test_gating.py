import numpy as np
import pytest

from megalopta.sensor.effects.gating import Gate, is_open, open_fraction, open_time, wall_time

WINDOW = (1.0, 0.3, 0.9)


def test_wall_time_is_the_inverse_of_open_time():
    for opened in np.linspace(-2, 5, 71):
        assert open_time(wall_time(opened, *WINDOW), *WINDOW) == pytest.approx(opened, abs=1e-12)
        assert is_open(wall_time(opened + 1e-6, *WINDOW), *WINDOW)


def test_open_time_is_the_integral_of_the_window():
    times = np.linspace(0, 10, 100_001)
    window = np.array([is_open(time, *WINDOW) for time in times[:-1] + 5e-5])
    assert open_time(10.0, *WINDOW) - open_time(0.0, *WINDOW) == pytest.approx(
        window.sum() * 1e-4, abs=2e-4
    )


def test_window_that_is_never_closed_changes_nothing():
    assert not Gate().is_on
    assert not Gate(period_s=1.0, width_s=1.0).is_on
    assert open_fraction(Gate(period_s=1.0, width_s=1.0, phase_s=0.4), 3.3) == pytest.approx(1)
