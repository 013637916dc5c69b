import numpy as np
import pytest

from megalopta.sensor.ctia.bias import FloatingGateBias, calibrate, leak_floor
from megalopta.sensor.ctia.integration import Pixel, estimate_current
from megalopta.sensor.ctia.photodiode import Photodiode

GATE = FloatingGateBias()
LEAKY = Photodiode(shunt_ohm=588.6e3)


def pixel(diode=LEAKY, bias_v=18.7e-3, gain=1e9, drift=0.0):
    return Pixel(diode, 10e-12, 3.3, gain, bias_v, drift)


def test_every_pulse_lowers_the_bias_by_a_step_less_the_leak():
    log = calibrate(GATE, pixel())
    biases = np.array([one.bias_v for one in log])
    spent = np.diff([0.0] + [one.elapsed_s for one in log])[:-1]
    spent[1:] -= GATE.pulse_s
    expected = -GATE.step_v + GATE.leak_v_s * (spent + GATE.pulse_s)
    np.testing.assert_allclose(np.diff(biases), expected, rtol=1e-9)


def test_loop_ends_at_the_floor_set_by_the_leak():
    log = calibrate(GATE, pixel())
    assert log[-2].bias_v < 0
    floor = leak_floor(pixel(drift=GATE.leak_v_s))
    assert log[-2].current_a == pytest.approx(floor, rel=1e-6)


def test_current_falls_with_every_pulse_but_the_last():
    currents = [one.current_a for one in calibrate(GATE, pixel())]
    assert np.all(np.diff(currents[:-1]) < 0)
    assert len(currents) == 18.7 // 0.5 + 3


def test_without_leak_a_pulse_too_many_stops_the_discharge():
    log = calibrate(FloatingGateBias(leak_v_s=0), pixel())
    assert log[-1].current_a == 0
    assert 0 < log[-2].bias_v < GATE.step_v


def test_finer_pulses_tune_finer_without_leak():
    def best(pulse_s):
        gate = FloatingGateBias(pulse_s=pulse_s, leak_v_s=0)
        return calibrate(gate, pixel(bias_v=2.45e-3))[-2].current_a

    assert best(1e-4) < best(1e-3) / 5


def test_floor_follows_from_the_crossing_times_of_a_parabola():
    diode = Photodiode(saturation_current_a=3.476e-12)
    one = pixel(diode, bias_v=0.0, drift=1.5e-6)
    # the diode bends by half of bias over n·k·T/q, 1.6 % at the 0.8 mV reached
    assert estimate_current(one) == pytest.approx(leak_floor(one), rel=0.02)


def test_forward_bias_at_the_start_is_refused():
    with pytest.raises(ValueError, match="forward"):
        calibrate(GATE, pixel(bias_v=-1e-3))
