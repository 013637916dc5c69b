import numpy as np
import pytest

from megalopta.scenes import Light


def test_sun_points_lie_on_the_disc_and_have_its_center_as_their_mean():
    sun = Light(level="daylight").lighting().sun
    points = sun.points(64)
    angle = np.degrees(np.arccos(np.clip(points @ sun.direction, -1, 1)))
    assert angle.max() <= 0.265
    # Half of an even disc lies within 1/√2 of its radius.
    assert (angle < 0.265 / np.sqrt(2)).mean() == pytest.approx(0.5, abs=1 / 64)
    np.testing.assert_allclose(points.mean(axis=0), sun.direction, atol=2e-4)
