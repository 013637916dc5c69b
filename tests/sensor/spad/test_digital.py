import numpy as np
import pytest

from megalopta.sensor.spad.digital import (
    LARGEST_CAPACITY,
    DigitalCounter,
    empty_counts,
    read_digital,
)

EVENTS = np.array([[0, 5, 319], [320, 321, 10**12]])


def test_counts_below_capacity_are_read_unchanged_and_full_counters_are_flagged():
    counts, saturated = read_digital(EVENTS, DigitalCounter(capacity=320))
    np.testing.assert_array_equal(counts, [[0, 5, 319], [320, 320, 320]])
    np.testing.assert_array_equal(saturated, [[False, False, False], [True, True, True]])


def test_wrapping_counter_keeps_the_low_bits_and_flags_what_went_round():
    counts, saturated = read_digital(
        np.array([0, 255, 256, 300, 513]), DigitalCounter.of_bits(8, "wrap")
    )
    np.testing.assert_array_equal(counts, [0, 255, 0, 44, 1])
    np.testing.assert_array_equal(saturated, [False, False, True, True, True])


@pytest.mark.parametrize(
    ("capacity", "dtype"),
    [(1, np.uint16), (65535, np.uint16), (65536, np.uint32), (LARGEST_CAPACITY, np.uint32)],
)
def test_counts_have_the_smallest_type_that_holds_the_capacity(capacity, dtype):
    assert empty_counts((2, 3), capacity).dtype == dtype


@pytest.mark.parametrize("bits", [0, 33])
def test_impossible_number_of_bits_is_refused(bits):
    with pytest.raises(ValueError, match="capacity"):
        DigitalCounter.of_bits(bits)
