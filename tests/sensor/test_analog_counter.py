import numpy as np
import pytest

from megalopta.sensor.analog_counter import AnalogCounter, analog_pixels, read_analog
from megalopta.sensor.randomness import generator

QUIET = AnalogCounter(step_v=10e-3)
SPREAD = AnalogCounter(
    step_v=10e-3, step_sigma_v=0.3e-3, leak_v_s=7.2e-3, leak_sigma_v_s=0.69e-3, adc_bits=12
)
RAMP = np.tile(np.arange(400), (50, 1))


def read(counter, events=RAMP, exposure_s=0.1):
    pixels = analog_pixels(counter, events.shape, exposure_s, 0)
    return read_analog(generator(0), events, counter, pixels, exposure_s)


def test_ten_millivolts_give_320_counts_and_thirty_107_less_what_rounds_down():
    assert QUIET.capacity == 320
    assert AnalogCounter(step_v=30e-3).capacity == 106


def test_without_noise_counts_are_exact_up_to_saturation_and_flagged_from_there():
    counts, saturated = read(QUIET)
    np.testing.assert_array_equal(counts, np.minimum(RAMP, 320))
    np.testing.assert_array_equal(saturated, RAMP >= 320)


def test_calibration_undoes_step_and_leak_of_every_pixel():
    counts, saturated = read(SPREAD)
    # a 12-bit step of 0.8 mV is less than a tenth of a count
    np.testing.assert_array_equal(counts[~saturated], RAMP[~saturated])


def test_uncalibrated_counts_show_the_mismatch_of_the_steps():
    counts, saturated = read(SPREAD.model_copy(update={"calibrated": False}))
    usable = (RAMP == 200) & ~saturated
    # 3 % of 200 counts; 50 pixels know their spread to 10 %
    assert counts[usable].std() == pytest.approx(6.0, rel=0.5)


def test_leak_without_calibration_reads_as_counts_of_its_own():
    leaky = AnalogCounter(step_v=1e-3, leak_v_s=0.1, leak_sigma_v_s=0.01)
    dark = np.zeros((100, 100), np.int64)
    counts, _ = read(leaky.model_copy(update={"calibrated": False}), dark)
    assert np.abs(counts - 0).max() <= 6  # spread of 1 mV, one step, about the mean that is known
    np.testing.assert_array_equal(read(leaky, dark)[0], 0)


def test_pixels_belong_to_the_device_and_not_to_the_image_size():
    small, large = (analog_pixels(SPREAD, shape, 0.1, 5) for shape in ((16, 16), (70, 90)))
    np.testing.assert_array_equal(small.step_v, large.step_v[:16, :16])
    assert small.leaked_v.std() == pytest.approx(0.69e-4, rel=0.25)


def test_leak_that_empties_the_counter_is_refused():
    with pytest.raises(ValueError, match=r"exposure_s: 1000; .*expose for less"):
        analog_pixels(SPREAD, (4, 4), 1000.0, 0)


@pytest.mark.parametrize(
    "wrong",
    [
        {"step_v": -1.0},
        {"step_v": 4.0},
        {"step_v": 0.01, "swing_v": 3.4},
        {"step_v": 0.01, "step_sigma_v": 0.01},
        {"step_v": 1e-6},
        {"step_v": 0.01, "adc_bits": 0},
    ],
)
def test_impossible_counter_is_refused(wrong):
    with pytest.raises(ValueError, match=r"step_v|swing_v|adc_bits"):
        AnalogCounter(**wrong)
