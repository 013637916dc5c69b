import numpy as np
import pytest

from megalopta.assets_gen.dead_leaves_model import dead_leaves, paint_leaf


def test_covariance_is_that_of_the_first_leaf_to_cover_either_of_two_points():
    # Two points share a leaf with probability γ(h)/(2γ(0) − γ(h)), γ the overlap of a leaf with
    # itself shifted by h (Matheron); pixels average 3 × 3 samples.
    radius, size = 3.0, 192
    image = dead_leaves((size, size), np.random.default_rng(4), (radius, radius))
    spectrum = np.abs(np.fft.fft2(image - image.mean())) ** 2
    measured = np.fft.ifft2(spectrum).real / spectrum.mean()

    def shared(x, y):
        half = np.minimum(np.hypot(x, y) / (2 * radius), 1)
        overlap = (2 * np.arccos(half) - 2 * half * np.sqrt(1 - half**2)) / np.pi
        return overlap / (2 - overlap)

    within = np.subtract.outer(np.arange(3), np.arange(3)).ravel() / 3

    def expected(lag):
        return np.mean(shared(lag + within[:, np.newaxis], within))

    # About 192²/(π·3²) = 1300 leaves: ± 0.028, and half of that over the four directions and with
    # the correlation falling; 5 standard deviations are 0.07. Leaves that add up instead of
    # covering each other would have γ(h)/γ(0), which is 0.15 more at h = 3.
    for lag in (1, 2, 3, 4, 8):
        four = [measured[lag, 0], measured[-lag, 0], measured[0, lag], measured[0, -lag]]
        assert np.mean(four) == pytest.approx(expected(lag) / expected(0), abs=0.07)


def test_leaf_over_the_corner_is_the_same_leaf_on_the_other_sides():
    middle, corner = np.zeros((40, 60)), np.zeros((40, 60))
    painted = [
        paint_leaf(image, tuple(center), 9.3, 0.5)
        for image, center in ((middle, (20.2, 30.4)), (corner, (0.2, 0.4)))
    ]
    assert painted[0] == painted[1] == pytest.approx(np.pi * 9.3**2, rel=0.03)
    np.testing.assert_array_equal(np.roll(corner, (20, 30), axis=(0, 1)), middle)


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"radii_px": (3.0, 2.0)}, "radii_px 3.0 … 2.0"),
        ({"values": (0.0, 1.0)}, "values 0.0 … 1.0"),
        ({"radii_px": (2.0, 30.0)}, "wider than the image of 50 × 90 px"),
    ],
)
def test_impossible_leaves_are_refused(choice, message):
    with pytest.raises(ValueError, match=message):
        dead_leaves((50, 90), np.random.default_rng(0), **{"radii_px": (2.0, 9.0), **choice})
