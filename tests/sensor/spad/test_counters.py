"""Digital and analog counters, and what an ADC reads; `test_physics.py` has brute force."""

import numpy as np
import pytest
from scipy.stats import linregress

from megalopta.sensor import (
    changed,
    event_moments,
    expose_adc,
    expose_binary,
    expose_rate,
    preset,
    reading_moments,
)
from megalopta.sensor.calibrate.correction import calibrate, correct
from megalopta.sensor.information import information
from megalopta.sensor.sampling.streams import generator
from megalopta.sensor.spad import counters

RATE = np.broadcast_to(np.geomspace(10, 1e5, 256).reshape(16, 16), (20, 16, 16))


@pytest.mark.parametrize("calibrated", [True, False])
def test_codes_become_the_counts_that_the_same_draws_make(calibrated):
    counter = {"step_sigma_v": 3e-4, "offset_sigma_v": 5e-3, "calibrated": calibrated}
    sensor = changed(preset("spadcam"), counter=counter)
    codes = expose_adc(RATE, sensor, seed=1, stream="a")
    exposure = expose_rate(RATE, sensor, seed=1, stream="a")
    assert isinstance(sensor.counter, counters.AnalogCounter)
    known = counters.nominal_pixels(sensor.counter, sensor.exposure_s)
    if calibrated:
        known = counters.analog_pixels(
            sensor.counter, (16, 16), sensor.exposure_s, sensor.device_seed
        )
    counts, saturated = counters.counts_of_codes(codes, sensor.counter, known)
    np.testing.assert_array_equal(counts, exposure.counts)
    # An ADC does not tell an empty counter from one that noise keeps off the bottom.
    assert not (saturated & ~exposure.saturated).any()
    assert (exposure.counts[exposure.saturated & ~saturated] > 300).all()


@pytest.mark.slow
@pytest.mark.parametrize("crosstalk", [0.0, 0.2])
def test_frames_of_one_stream_are_as_random_as_those_of_their_own(crosstalk):
    counter = {"read_noise_v": 0, "adc_bits": 16, "leak_v_s": 0, "leak_sigma_v_s": 0}
    changes = {"counter": counter, "crosstalk": {"mean_fired_neighbors": crosstalk}}
    sensor = changed(preset("spadcam"), exposure_s=1e-3, **changes)
    if crosstalk:
        sensor = changed(sensor, dead_time={"kind": "ideal", "dead_time_s": 0})
    rate = np.broadcast_to(RATE[0], (4000, 16, 16))
    single, together = (
        expose_adc(rate[:n], sensor, seed=1, stream="a", together=count)
        for n, count in ((8, 1), (4000, 1000))
    )
    np.testing.assert_array_equal(together[0], single[0])
    assert isinstance(sensor.counter, counters.AnalogCounter)
    counts, _ = counters.counts_of_codes(
        together, sensor.counter, counters.nominal_pixels(sensor.counter, sensor.exposure_s)
    )
    mean, variance = np.array(event_moments(RATE[:1], sensor))[:, 0]
    # 256 means: false alarm below 1e-6 at 6 σ; moments with crosstalk are exact without dead time.
    z = (counts.mean(0) - mean) / np.sqrt(variance / 4000)
    assert np.abs(z).max() < 6
    # No frame resembles the one after it: correlation, over a million pairs, is within 6/√n.
    deviations = (counts - mean) / np.sqrt(variance)
    assert abs((deviations[1:] * deviations[:-1]).mean()) < 6 / 1000


def test_impossible_counters_are_refused():
    with pytest.raises(ValueError, match="analog"):
        expose_adc(RATE, preset("ideal"), seed=1, stream="a")
    with pytest.raises(ValueError, match="adc_bits: 20"):
        expose_adc(RATE, changed(preset("spadcam"), counter={"adc_bits": 20}), seed=1, stream="a")
    with pytest.raises(ValueError, match=r"exposure_s: 1000; .*expose for less"):
        counters.analog_pixels(preset("spadcam").counter, (128, 128), 1000.0, 0)


QUIET = counters.AnalogCounter(step_v=10e-3)
RAMP = np.tile(np.arange(400), (50, 1))


def read(counter, events=RAMP, exposure_s=0.1):
    pixels = counters.analog_pixels(counter, events.shape, exposure_s, 0)
    return counters.read_analog(generator(0), events, counter, pixels, exposure_s)


def test_without_noise_counts_are_exact_up_to_saturation_and_flagged_from_there():
    counts, saturated = read(QUIET)
    np.testing.assert_array_equal(counts, np.minimum(RAMP, 320))
    np.testing.assert_array_equal(saturated, RAMP >= 320)


def test_steps_of_any_slope_take_the_same_swing_and_the_printed_straightness_allows_six_tenths():
    for slope, most in ((0.0, 0.0), (0.6, 0.0105), (-0.6, 0.0105)):
        counter = changed(QUIET, step_slope=slope, swing_v=3.2)
        counts, saturated = read(counter, np.arange(400)[None])
        line = linregress(np.arange(400)[~saturated[0]], counts[~saturated])
        assert 1 - line.rvalue**2 <= most + 1e-4
        # 3.2 V at 10 mV; a slope adds 1/12 of its square
        assert saturated[0].argmax() == pytest.approx(320 * (1 + slope**2 / 12), abs=3)
        first = np.diff(counts[0, :40]).mean()
        assert first == pytest.approx(1 + slope / 2, abs=0.05)


def test_a_sum_of_binary_frames_is_binomial_and_tells_as_much_as_they_do():
    bits = changed(preset("ideal"), exposure_s=1e-3, counter={"capacity": 1})
    summed = changed(bits, exposure_s=0.05, counter={"sums": 50})
    photons = np.array([0.5, 10.0, 60.0, 200.0])
    chance = -np.expm1(-photons / 50)
    mean, variance = reading_moments((photons / 0.05).reshape(1, 1, -1), summed)
    np.testing.assert_allclose(mean.ravel(), 50 * chance, rtol=1e-9)
    np.testing.assert_allclose(variance.ravel(), 50 * chance * (1 - chance), rtol=1e-9)
    # of n independent frames with an nth of the photons each: (∂p/∂µ)²/(p·(1 − p)) over n
    told = information(photons, summed)
    np.testing.assert_allclose(told, (1 - chance) / chance / 50, rtol=1e-3)
    drawn = expose_rate(np.full((1, 40, 50), 1e9), summed, seed=1, stream="s")
    assert (drawn.counts == 50).all() and drawn.saturated.all()
    with pytest.raises(ValueError, match=r"counter\.sums: 50; give 1"):
        expose_binary(np.ones((1, 4, 4)), summed, seed=1, stream="s")


def test_corrected_sums_of_binary_frames_are_the_detections():
    sensor = changed(
        preset("ideal"),
        **{"exposure_s": 1e-2, "counter": {"capacity": 1, "sums": 100}},
        **{"dark_counts": {"bulk_mean_hz_um2": 1.0}, "crosstalk": {"mean_fired_neighbors": 0.05}},
    )
    light = {
        name: np.full((60, 16, 16), hz) for name, hz in {"dark": 0, "flat": 4e3, "lit": 7e3}.items()
    }
    drawn = {name: expose_rate(hz, sensor, seed=2, stream=name) for name, hz in light.items()}
    calibration = calibrate(drawn["dark"].counts, drawn["flat"].counts, sensor)
    corrected = correct(drawn["lit"].counts, drawn["lit"].saturated, calibration)
    # 15 360 readings of 70 ± 11 detections, and as many of the flat frames: five standard errors
    assert abs(corrected.detections.mean() - 70) < 5 * 11 * np.sqrt(2 / 15_360) + 0.002 * 70
    # stated are also errors of 60 dark and flat frames, which every frame shares
    assert 1 < corrected.variance.mean() / corrected.detections.var(axis=0).mean() < 1.15
