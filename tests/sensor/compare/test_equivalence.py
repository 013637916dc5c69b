"""One quantity in two recordings, and what a calibration does not know of it."""

import numpy as np
import pytest
from scipy.stats import norm

from megalopta.sensor.compare.quantities import CountedFrames
from megalopta.sensor.compare.recordings import compare_recordings
from megalopta.sensor.compare.two_sample import Quantity, difference


def test_what_a_calibration_does_not_know_widens_the_interval():
    rng = np.random.default_rng(6)
    one, other = rng.normal(1.1, 1e-6, 20), rng.normal(1.0, 1e-6, 20)
    found = difference(Quantity("rate"), one, other, margin=0.05, unsure=0.05)
    # blocks that hardly scatter: all of the error is the calibration's, and normal but for t
    assert found.p == pytest.approx(2 * norm.sf(2), rel=0.3)
    assert found.high - found.low == pytest.approx(2 * 1.96 * 0.05, rel=0.05)
    assert difference(Quantity("rate"), one, other, margin=0.05).p < 1e-12


def test_dark_counts_of_a_calibration_that_is_off_by_its_error_raise_no_alarm():
    rng = np.random.default_rng(7)
    frames, shape, off = 1000, (8, 8), 0.4
    # pixels known to 40 %, and so the mean of 64 to 5 %; it is off by twice that
    expected = rng.poisson(40.0, (frames, *shape)).astype(float)
    captured = rng.poisson(40.0 * (1 + 2 * off / 8), (frames, *shape)).astype(float)
    levels = [CountedFrames(captured, 0.1)], [CountedFrames(expected, 0.1)]
    sure = compare_recordings(*levels)
    unsure = compare_recordings(*levels, errors=[np.full(shape, off * 40.0)])
    (before, after) = (
        next(each for each in found.differences if each.name == "dark counts")
        for found in (sure, unsure)
    )
    assert before.relative == after.relative
    assert before.p < 1e-3 < after.p
