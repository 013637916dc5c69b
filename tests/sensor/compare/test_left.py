"""Moments of all frames of a recording: those of NumPy, and a drift that the first do not show."""

import numpy as np

from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.left import Whole


def test_moments_of_all_frames_are_those_of_numpy():
    frames = np.random.default_rng(1).poisson(20, (70, 5, 8)).astype(np.uint16)
    whole = Whole.of(frames)
    np.testing.assert_allclose(whole.pixels.mean, frames.mean(axis=0))
    np.testing.assert_allclose(whole.pixels.variance, frames.var(axis=0, ddof=1))
    np.testing.assert_allclose(whole.rows, frames.mean(axis=2))
    np.testing.assert_allclose(whole.columns, frames.mean(axis=1))


def test_only_lines_that_change_are_unsteady():
    frames = np.random.default_rng(2).poisson(20, (400, 16, 16)).astype(np.uint16)
    level = Level(frames, 1e-3)
    assert not Whole.of(frames).unsteady(level)
    frames[200:, 7] += 2
    left = {one.name: one.size for one in Whole.of(frames).unsteady(level)}
    assert left["time in rows of all frames"] == 7
