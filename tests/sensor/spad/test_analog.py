import numpy as np
import pytest
from scipy.stats import linregress

from megalopta.sensor import changed
from megalopta.sensor.sampling.streams import generator
from megalopta.sensor.spad.counters import AnalogCounter, analog_pixels, read_analog

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


def test_leak_without_calibration_reads_as_counts_of_its_own():
    leaky = AnalogCounter(step_v=1e-3, leak_v_s=0.1, leak_sigma_v_s=0.01)
    dark = np.zeros((100, 100), np.int64)
    counts, _ = read(changed(leaky, calibrated=False), dark)
    assert np.abs(counts - 0).max() <= 6  # spread of 1 mV, one step, about the mean that is known
    np.testing.assert_array_equal(read(leaky, dark)[0], 0)


def test_counter_at_the_bottom_is_flagged_whatever_noise_makes_of_its_reading():
    noisy = AnalogCounter(step_v=10e-3, read_noise_v=50e-3)
    counts, saturated = read(noisy, np.full((50, 50), 400))
    assert np.mean(counts < noisy.capacity) > 0.3
    assert saturated.all()


@pytest.mark.parametrize(
    "wrong",
    [
        {"step_v": -1.0},
        {"step_v": 4.0},
        {"step_v": 0.01, "swing_v": 3.4},
        {"step_v": 0.01, "step_sigma_v": 0.0012},
        {"step_v": 0.01, "leak_v_s": 1e-3, "leak_sigma_v_s": 5e-3},
        {"step_v": 1e-6},
        {"step_v": 0.01, "adc_bits": 0},
    ],
)
def test_impossible_counter_is_refused(wrong):
    with pytest.raises(ValueError, match=r"step_v|swing_v|adc_bits|step_sigma_v|leak_sigma_v_s"):
        AnalogCounter(**wrong)


SMALL = 3.2 / 65000


@pytest.mark.parametrize(
    ("counter", "exposure_s", "message"),
    [
        (SPREAD, 1000.0, r"exposure_s: 1000; .*expose for less"),
        (
            AnalogCounter(step_v=SMALL, step_sigma_v=SMALL / 9),
            0.1,
            r"smallest step makes more than 65535 counts; make it",
        ),
    ],
)
def test_device_that_cannot_count_is_refused(counter, exposure_s, message):
    with pytest.raises(ValueError, match=message):
        analog_pixels(counter, (128, 128), exposure_s, 0)


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


def test_each_step_errs_alone():
    counter = changed(QUIET, step_noise_v=1e-3)
    for events in (25, 225):
        counts, _ = read(counter, np.full((200, 200), events))
        # √N tenths of a count, and rounding; false alarm 6e-7
        expected = 0.01 * events + 1 / 12
        assert counts.var() == pytest.approx(expected, rel=5 * (2 / 40_000) ** 0.5 + 0.03)


def test_calibration_takes_the_offset_out_and_without_it_it_reads_as_counts():
    offset = changed(QUIET, offset_sigma_v=30e-3)
    events = np.full((60, 60), 100)
    np.testing.assert_array_equal(read(offset, events)[0], 100)
    counts, _ = read(changed(offset, calibrated=False), events)
    # 3 counts; 3600 pixels know their spread to 1.2 %, five times which is 6 %
    assert counts.std() == pytest.approx((9 + 1 / 12) ** 0.5, rel=0.06)
