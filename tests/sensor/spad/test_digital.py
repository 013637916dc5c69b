import numpy as np
import pytest

from megalopta.sensor.spad.counters import (
    LARGEST_CAPACITY,
    DigitalCounter,
    empty_counts,
    read_digital,
)


@pytest.mark.parametrize(
    ("capacity", "dtype"),
    [(1, np.uint16), (65535, np.uint16), (65536, np.uint32), (LARGEST_CAPACITY, np.uint32)],
)
def test_counts_have_the_smallest_type_that_holds_the_capacity(capacity, dtype):
    assert empty_counts((2, 3), capacity).dtype == dtype


@pytest.mark.parametrize(
    ("counter", "events", "expected", "flagged"),
    [
        (DigitalCounter(capacity=320), [0, 319, 320, 321, 10**12], [0, 319, 320, 320, 320], 2),
        (
            DigitalCounter(capacity=255, overflow="wrap"),
            [0, 255, 256, 300, 513],
            [0, 255, 0, 44, 1],
            2,
        ),
    ],
)
def test_counts_are_read_as_far_as_the_counter_goes_and_flagged_from_there(
    counter, events, expected, flagged
):
    counts, saturated = empty_counts((5,), counter.capacity), np.empty(5, bool)
    read_digital(np.array(events), counter, (counts, saturated))
    np.testing.assert_array_equal(counts, expected)
    np.testing.assert_array_equal(saturated, np.arange(5) >= flagged)
