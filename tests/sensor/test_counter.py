import numpy as np
import pytest

from megalopta.sensor.counter import LARGEST_CAPACITY, read_counter

EVENTS = np.array([[0, 5, 319], [320, 321, 10**12]])


def test_counts_below_capacity_are_read_unchanged_and_full_counters_are_flagged():
    counts, saturated = read_counter(EVENTS, 320)
    np.testing.assert_array_equal(counts, [[0, 5, 319], [320, 320, 320]])
    np.testing.assert_array_equal(saturated, [[False, False, False], [True, True, True]])


@pytest.mark.parametrize(
    ("capacity", "dtype"),
    [(1, np.uint16), (65535, np.uint16), (65536, np.uint32), (LARGEST_CAPACITY, np.uint32)],
)
def test_counts_have_the_smallest_type_that_holds_the_capacity(capacity, dtype):
    counts, _ = read_counter(EVENTS, capacity)
    assert counts.dtype == dtype
    assert counts.max() == capacity
