import numpy as np
import pytest

from megalopta.sensor.ctia.bias import (
    DacBias,
    FixedBias,
    FloatingGateBias,
    calibrate_gate,
    drift_rate,
    gate_bias,
    leak_floor,
    trimmed_bias,
)
from megalopta.sensor.ctia.integration import Pixel, estimate_current
from megalopta.sensor.ctia.photodiode import Photodiode

OFFSETS = np.random.default_rng(0).normal(18.7e-3, 10e-3, 5000)


def test_twelve_bits_on_the_rail_step_by_0_81_mv():
    assert DacBias().step_v == pytest.approx(0.81e-3, abs=0.005e-3)


@pytest.mark.parametrize("bias", [DacBias(), DacBias(target_v=2e-3), FloatingGateBias()])
def test_trimmed_bias_is_spread_evenly_over_one_step_above_the_target(bias):
    left = (trimmed_bias(bias, OFFSETS) - bias.target_v) / bias.step_v
    assert np.all((left >= -1e-9) & (left < 1 + 1e-9))
    # mean of 5000 uniforms: |z| < 5, false alarm 6e-7
    assert abs(left.mean() - 0.5) < 5 * np.sqrt(1 / 12 / left.size)


def test_floating_gate_is_where_pulses_one_by_one_leave_it():
    gate = FloatingGateBias(erased_v=20e-3, target_v=2e-3)
    left = trimmed_bias(gate, OFFSETS)
    expected = OFFSETS + gate.erased_v
    for _ in range(200):
        expected -= gate.step_v * (expected - gate.step_v >= gate.target_v)
    np.testing.assert_allclose(left, expected, atol=1e-12)
    assert np.any(left < gate.target_v)


def test_leak_takes_back_a_millivolt_in_1000_s_and_a_degree_another():
    gate = FloatingGateBias()
    assert gate_bias(gate, 0.0, wait_s=1000) == pytest.approx(1.5e-3)
    assert gate_bias(gate, 0.0, warming_k=2.0) == pytest.approx(2e-3)
    aged = FloatingGateBias(age_s=100, warming_k=-1)
    np.testing.assert_allclose(
        trimmed_bias(aged, OFFSETS) - trimmed_bias(gate, OFFSETS), 150e-6 - 1e-3, atol=1e-15
    )


def test_fixed_bias_keeps_the_offsets_and_only_the_gate_drifts():
    np.testing.assert_array_equal(trimmed_bias(FixedBias(reverse_bias_v=1.0), OFFSETS), OFFSETS + 1)
    assert [drift_rate(b) for b in (FixedBias(), DacBias(), FloatingGateBias())] == [0, 0, 1.5e-6]


GATE = FloatingGateBias()
LEAKY = Photodiode(shunt_ohm=588.6e3)


def pixel(diode=LEAKY, bias_v=18.7e-3, gain=1e9, drift=0.0):
    return Pixel(diode, 10e-12, 3.3, gain, bias_v, drift)


def test_every_pulse_lowers_the_bias_by_a_step_less_the_leak():
    log = calibrate_gate(GATE, pixel())
    biases = np.array([one.bias_v for one in log])
    spent = np.diff([0.0] + [one.elapsed_s for one in log])[:-1]
    spent[1:] -= GATE.pulse_s
    expected = -GATE.step_v + GATE.leak_v_s * (spent + GATE.pulse_s)
    np.testing.assert_allclose(np.diff(biases), expected, rtol=1e-9)


def test_loop_ends_at_the_floor_set_by_the_leak():
    log = calibrate_gate(GATE, pixel())
    assert log[-2].bias_v < 0
    floor = leak_floor(pixel(drift=GATE.leak_v_s))
    assert log[-2].current_a == pytest.approx(floor, rel=1e-6)


def test_without_leak_a_pulse_too_many_stops_the_discharge():
    log = calibrate_gate(FloatingGateBias(leak_v_s=0), pixel())
    assert log[-1].current_a == 0
    assert 0 < log[-2].bias_v < GATE.step_v


def test_floor_follows_from_the_crossing_times_of_a_parabola():
    diode = Photodiode(saturation_current_a=3.476e-12)
    one = pixel(diode, bias_v=0.0, drift=1.5e-6)
    # the diode bends by half of bias over n·k·T/q, 1.6 % at the 0.8 mV reached
    assert estimate_current(one) == pytest.approx(leak_floor(one), rel=0.02)


def test_what_no_bias_can_do_is_refused():
    with pytest.raises(ValueError, match="cannot be compensated"):
        trimmed_bias(DacBias(), 2.0)
    with pytest.raises(ValueError, match="pulse_s"):
        FloatingGateBias(pulse_s=0)
    with pytest.raises(ValueError, match="forward"):
        calibrate_gate(GATE, pixel(bias_v=-1e-3))
