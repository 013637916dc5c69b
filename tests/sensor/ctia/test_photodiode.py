import numpy as np
import pytest
from scipy.constants import e, k
from scipy.optimize import brentq

from megalopta.sensor.ctia.photodiode import (
    ELEMENTARY_CHARGE_C,
    Photodiode,
    junction_currents,
    noise_current,
    open_circuit_voltage,
    reverse_current,
)

IDEAL = Photodiode(saturation_current_a=100e-12)
SHUNT = Photodiode(shunt_ohm=1e9)
BOTH = Photodiode(saturation_current_a=3e-12, ideality=1.4, temperature_k=280, shunt_ohm=2e11)


def test_reverse_current_is_minus_the_shockley_law_of_the_forward_bias():
    bias = np.linspace(-0.2, 0.5, 29)
    forward = -bias
    shockley = 3e-12 * (np.exp(forward / BOTH.slope_v) - 1) + forward / 2e11
    np.testing.assert_allclose(reverse_current(BOTH, bias), -shockley, rtol=1e-9, atol=1e-24)


def test_conductance_at_zero_bias_is_the_slope_of_the_current():
    step = 1e-7
    slope = (reverse_current(BOTH, step) - reverse_current(BOTH, -step)) / (2 * step)
    assert BOTH.zero_bias_s == pytest.approx(slope, rel=1e-9)


@pytest.mark.parametrize("photocurrent", [0.0, 1e-18, 1e-13, 1e-9, 1e-3])
@pytest.mark.parametrize("scale", [1.0, 7.0])
def test_open_circuit_voltage_balances_the_photocurrent(photocurrent, scale):
    expected = brentq(lambda v: reverse_current(BOTH, -v, scale) + photocurrent, 0, 2, xtol=1e-16)
    voltage = open_circuit_voltage(BOTH, photocurrent, scale)
    assert voltage == pytest.approx(expected, rel=1e-9, abs=1e-15)


def test_open_circuit_voltage_of_pure_laws():
    assert open_circuit_voltage(SHUNT, 1e-9) == pytest.approx(1.0)
    assert open_circuit_voltage(IDEAL, 100e-12) == pytest.approx(IDEAL.slope_v * np.log(2))
    assert open_circuit_voltage(Photodiode(), 1e-9) == np.inf


@pytest.mark.parametrize("ideality", [1.0, 1.5, 2.0])
def test_noise_at_zero_bias_is_thermal_noise_of_the_zero_bias_conductance(ideality):
    # 2·q·I_eq = 4·k·T·g, the theorem of Nyquist
    diode = Photodiode(saturation_current_a=3e-12, ideality=ideality, shunt_ohm=2e11)
    nyquist = 4 * k * diode.temperature_k * diode.zero_bias_s
    assert 2 * ELEMENTARY_CHARGE_C * noise_current(diode, 0.0) == pytest.approx(nyquist)


@pytest.mark.parametrize("ideality", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("bias", [-0.3, -0.05, -1e-4, 1e-6, 1e-3, 0.05, 2.0])
def test_noise_at_any_bias_is_that_of_detailed_balance(ideality, bias):
    diode = Photodiode(saturation_current_a=3e-12, ideality=ideality)
    expected = reverse_current(diode, bias) / np.tanh(e * bias / (2 * k * diode.temperature_k))
    assert noise_current(diode, bias) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("ideality", [1.0, 1.5, 2.0])
def test_currents_both_ways_differ_by_the_net_current_and_exist_at_any_bias(ideality):
    diode = Photodiode(saturation_current_a=3e-12, ideality=ideality)
    bias = np.linspace(-0.4, 0.4, 81)
    reverse, forward = junction_currents(diode, bias)
    assert (reverse >= 0).all() and (forward >= 0).all()
    np.testing.assert_allclose(reverse - forward, reverse_current(diode, bias), 1e-9, 1e-24)
    np.testing.assert_allclose(junction_currents(diode, np.array([300.0]))[1], 0)
    assert junction_currents(diode, np.array([-300.0]))[1] == np.inf  # as `reverse_current`
