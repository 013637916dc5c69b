"""Devices whose pixels are known, calibrated from what their ADC reads."""

import numpy as np
import pytest

from megalopta.sensor.calibrate.device import calibrate_device
from megalopta.sensor.spad.device import draw_fixed_pattern

from .devices import NANOMETERS, SHAPE, adc_of, device, levels_of

NAMES = ("dark_counts_hz", "efficiency", "step_v", "leak_v_s", "dead_time_s")


def covered(sensor):
    """Share of pixels whose stated 95 % interval holds the truth, by quantity."""
    found = calibrate_device(levels_of(sensor), adc_of(sensor))
    pattern = draw_fixed_pattern(sensor, SHAPE)
    curve = sensor.efficiency
    truth = {
        "dark_counts_hz": pattern.dark_counts_hz,
        "efficiency": pattern.efficiency_factor
        * np.interp(NANOMETERS, curve.wavelengths_nm, curve.values),
        "step_v": pattern.counters.step_v,
        "leak_v_s": pattern.counters.leaked_v / sensor.exposure_s,
        "dead_time_s": np.full(SHAPE, sensor.dead_time.dead_time_s),
    }
    shares = {}
    for name, value in truth.items():
        estimate = getattr(found, name)
        shares[name] = float(((estimate.low <= value) & (value <= estimate.high)).mean())
    return shares, found


@pytest.mark.slow
def test_intervals_hold_the_truth_over_20_devices():
    shares, devices = zip(*(covered(device(seed)) for seed in range(20)), strict=True)
    assert {(each.method, each.dead_time_kind) for each in devices} == {("comb", "paralyzable")}
    mean = {name: np.mean([each[name] for each in shares]) for name in NAMES}
    # 5120 pixels: the standard error of a share of 95 % is 0.3 %
    assert all(0.93 <= share <= 0.97 for share in mean.values()), mean


@pytest.mark.slow
def test_the_other_kind_of_dead_time_is_named():
    sensor = device(seed=5, kind="nonparalyzable")
    shape = (4, 4)
    found = calibrate_device(levels_of(sensor, 150, shape=shape), adc_of(sensor))
    assert found.dead_time_kind == "nonparalyzable"
    assert np.median(found.dead_time_s.value) == pytest.approx(1e-6, rel=0.05)


@pytest.mark.slow  # covered without so much noise above, with more below
def test_steps_of_a_noisy_comb():
    """Read noise of 0.22 steps, where one reading in forty is nearer to another tooth."""
    sensor = device(seed=6, read_noise_v=2.2e-3)
    found = calibrate_device(levels_of(sensor, 150, shape=(8, 8)), adc_of(sensor))
    truth = draw_fixed_pattern(sensor, (8, 8)).counters.step_v
    z = (found.step_v.value - truth) / ((found.step_v.high - found.step_v.low) / 3.92)
    assert found.method == "comb"
    # χ² of 64 pixels: a root mean square above 1.5 has a chance below 1e-6
    assert np.sqrt(np.nanmean(z**2)) < 1.5


@pytest.mark.slow
def test_a_comb_that_noise_hides_is_left_to_photon_transfer():
    sensor = device(seed=7, read_noise_v=8e-3)
    found = calibrate_device(levels_of(sensor, 400, shape=(8, 8)), adc_of(sensor))
    assert found.method == "photon transfer"
    assert np.isnan(found.leak_v_s.value).all()
    # each step to about 5 %, the median of 64 to about 0.8 %
    assert np.median(found.step_v.value) == pytest.approx(0.01, rel=0.05)


@pytest.mark.slow
def test_hot_pixels_are_marked():
    sensor = device(seed=21)
    found = calibrate_device(levels_of(sensor, 60), adc_of(sensor), hot_times=5)
    truth = draw_fixed_pattern(sensor, SHAPE).dark_counts_hz
    clear = np.abs(truth / (5 * np.median(truth)) - 1) > 0.1
    assert (found.hot == (truth > 5 * np.median(truth)))[clear].all()
