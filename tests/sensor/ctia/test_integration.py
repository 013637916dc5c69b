from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from megalopta.sensor.ctia import integration as ctia
from megalopta.sensor.ctia.photodiode import Photodiode, reverse_current

FARAD, SWING = 100e-15, 3.3
IDEAL = Photodiode(saturation_current_a=100e-12)
SHUNT = Photodiode(shunt_ohm=588e3)
BOTH = Photodiode(saturation_current_a=100e-12, shunt_ohm=1e8)
NONE = Photodiode()


def pixel(diode, gain_db=40.0, bias_v=1e-3, **more):
    return ctia.Pixel(diode, FARAD, SWING, ctia.gain_from_db(gain_db), bias_v, **more)


def by_solver(pixel, light, times):
    """Independent: a general-purpose solver on the equation as printed."""

    def slope(t, s):
        bias = pixel.bias_v + pixel.drift_v_s * t + s / pixel.gain
        return (light + reverse_current(pixel.diode, bias)) / pixel.capacitance_f

    method = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-12}
    return solve_ivp(slope, (0, times[-1]), [0.0], t_eval=times, **method).y[0]


@pytest.mark.parametrize("gain_db", [40, 130])
@pytest.mark.parametrize("light", [0.0, 3e-12])
@pytest.mark.parametrize("drift", [0.0, 1e-2])
@pytest.mark.parametrize("diode", [IDEAL, BOTH])
def test_discharge_agrees_with_a_general_solver(diode, gain_db, light, drift):
    one = pixel(diode, gain_db, drift_v_s=drift)
    times = np.linspace(0, float(ctia.discharge_time(one, light, 0.999 * SWING)), 7)
    expected = by_solver(one, light, times)
    np.testing.assert_allclose(ctia.discharge(one, light, times), expected, atol=3e-6)


@pytest.mark.parametrize(("bias", "tolerance"), [(1e-3, 1e-6), (1e-6, 7e-5), (1e-9, 7e-4)])
def test_error_of_the_integrator_is_the_one_stated(bias, tolerance):
    one = pixel(SHUNT, 40, bias_v=bias)
    end = np.log1p(SWING / (one.gain * bias)) * one.gain * 588e3 * FARAD
    assert abs(ctia.discharge(one, 0.0, end) / SWING - 1) < tolerance


def test_one_step_is_enough_for_the_built_pixel():
    leaky = Photodiode(saturation_current_a=100e-12, shunt_ohm=588.6e3)
    built = ctia.Pixel(leaky, 10e-12, SWING, ctia.gain_from_db(130.0), 1e-3, drift_v_s=1.5e-6)
    expected = by_solver(built, 1e-12, np.array([1e-3, 1e-2]))
    np.testing.assert_allclose(ctia.discharge(built, 1e-12, 1e-2), expected[1], rtol=1e-9)


@pytest.mark.parametrize("diode", [IDEAL, SHUNT, BOTH])
@pytest.mark.parametrize("bias", [1e-9, 1e-3, 0.1])
def test_time_and_discharge_are_inverse(diode, bias):
    one = pixel(diode, bias_v=bias, gain_db=60.0)
    volts = np.array([0.01, 0.33, 1.65, 2.97, SWING])
    np.testing.assert_allclose(
        ctia.discharge(one, 1e-15, ctia.discharge_time(one, 1e-15, volts)), volts, rtol=1e-9
    )


def test_forward_biased_pixel_does_not_discharge():
    one = pixel(BOTH, bias_v=-1e-3)
    assert ctia.discharge(one, 0.0, 1e6) == 0
    assert ctia.discharge_time(one, 0.0, 0.1) == np.inf
    assert ctia.estimate_current(one) == 0


def test_light_discharges_a_pixel_in_slight_forward_bias():
    one = pixel(IDEAL, 130, bias_v=-1e-3)
    net = 10e-12 + reverse_current(IDEAL, -1e-3)
    assert ctia.discharge(one, 10e-12, 1e-3) == pytest.approx(net * 1e-3 / FARAD, rel=1e-4)


@pytest.mark.parametrize("diode", [IDEAL, BOTH])
def test_drift_frees_a_forward_biased_pixel_when_it_crosses_zero(diode):
    one = pixel(diode, 130, bias_v=-1e-3, drift_v_s=1e-2)
    later = replace(one, bias_v=0.0)
    assert ctia.discharge(one, 0.0, 0.1) == 0
    np.testing.assert_allclose(
        ctia.discharge(one, 0.0, 0.1 + np.array([0.01, 0.1])),
        ctia.discharge(later, 0.0, np.array([0.01, 0.1])),
        rtol=1e-9,
    )


def test_estimate_is_the_current_itself_when_it_is_constant():
    assert ctia.estimate_current(pixel(NONE), 2e-12) == pytest.approx(2e-12, rel=1e-9)


def test_impossible_requests_are_refused():
    for volts in (0.0, 3.4, np.nan):
        with pytest.raises(ValueError, match="discharged_v"):
            ctia.discharge_time(pixel(IDEAL), 0.0, volts)


def test_discharge_never_passes_the_swing():
    assert (
        ctia.discharge(pixel(IDEAL), 0.0, 10.0) == ctia.discharge(pixel(BOTH), 0.0, 10.0) == SWING
    )
