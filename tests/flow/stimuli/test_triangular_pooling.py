import numpy as np
import pytest

from megalopta.flow import triangular_pool


def test_five_taps_are_two_running_means_of_three():
    row = np.random.default_rng(0).poisson(40, (7, 1, 16))
    # a triangle is a box convolved with itself
    once = (row[..., :-2] + row[..., 1:-1] + row[..., 2:]) / 3
    twice = (once[..., :-2] + once[..., 1:-1] + once[..., 2:]) / 3
    assert twice.shape == (7, 1, 12)
    np.testing.assert_allclose(triangular_pool(row), twice, rtol=1e-12)


def test_a_ramp_stays_in_place():
    ramp = np.arange(9.0)
    for taps in (1, 3, 5, 9):
        margin = (taps - 1) // 2
        np.testing.assert_allclose(triangular_pool(ramp, taps), ramp[margin : 9 - margin])


@pytest.mark.parametrize("taps", [4, 0, -1, 17])
def test_kernel_without_a_middle_or_too_long_is_refused(taps):
    with pytest.raises(ValueError, match=f"taps {taps} for rows of 16 px: use an odd number"):
        triangular_pool(np.ones((3, 16)), taps)
