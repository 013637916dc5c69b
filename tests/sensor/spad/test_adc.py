"""What the ADC reads, against the counts made of it."""

import numpy as np
import pytest

from megalopta.sensor import AnalogCounter, changed, expose_adc, expose_rate, preset
from megalopta.sensor.counters import analog_pixels, counts_of_codes, nominal_pixels

RATE = np.broadcast_to(np.geomspace(10, 1e5, 256).reshape(16, 16), (20, 16, 16))


@pytest.mark.parametrize("calibrated", [True, False])
def test_codes_become_the_counts_that_the_same_draws_make(calibrated):
    counter = {"step_sigma_v": 3e-4, "offset_sigma_v": 5e-3, "calibrated": calibrated}
    sensor = changed(preset("spadcam"), counter=counter)
    codes = expose_adc(RATE, sensor, seed=1, sequence="a")
    exposure = expose_rate(RATE, sensor, seed=1, sequence="a")
    assert isinstance(sensor.counter, AnalogCounter)
    known = nominal_pixels(sensor.counter, sensor.exposure_s)
    if calibrated:
        known = analog_pixels(sensor.counter, (16, 16), sensor.exposure_s, sensor.device_seed)
    counts, saturated = counts_of_codes(codes, sensor.counter, known)
    np.testing.assert_array_equal(counts, exposure.counts)
    # An ADC does not tell an empty counter from one that noise keeps off the bottom.
    assert not (saturated & ~exposure.saturated).any()
    assert (exposure.counts[exposure.saturated & ~saturated] > 300).all()


def test_a_digital_counter_has_no_codes():
    with pytest.raises(ValueError, match="analog"):
        expose_adc(RATE, preset("ideal"), seed=1, sequence="a")


def test_codes_beyond_16_bits_are_refused():
    with pytest.raises(ValueError, match="adc_bits: 20"):
        expose_adc(RATE, changed(preset("spadcam"), counter={"adc_bits": 20}), seed=1, sequence="a")


def test_codes_of_light_in_parts_are_of_frames():
    parts = np.stack([RATE[:3] / 2, 3 * RATE[:3] / 2], axis=1)
    codes = expose_adc(parts, preset("spadcam"), seed=1, sequence="a")
    assert codes.shape == (3, 16, 16)
    exposure = expose_rate(parts, preset("spadcam"), seed=1, sequence="a")
    sensor = preset("spadcam")
    known = analog_pixels(sensor.counter, (16, 16), sensor.exposure_s, sensor.device_seed)
    np.testing.assert_array_equal(counts_of_codes(codes, sensor.counter, known)[0], exposure.counts)
