"""Crosstalk from pairs of pixels against the kernel that gave them."""

from pathlib import Path

import numpy as np
import pytest

from megalopta.camera.capture_files import read_measurement
from megalopta.sensor import Crosstalk
from megalopta.sensor.calibrate.pair_crosstalk import PairCrosstalk, fit_crosstalk, modelled

LIGHT = Crosstalk(
    mean_fired_neighbors=0.05, diagonal=0.3, distance_two=0.05, distance_three=0.01
)  # fmt: skip


def test_pairs_return_the_crosstalk_that_made_them():
    down, right = (each.ravel() for each in np.indices((4, 6)))
    zeros = np.zeros(down.size)
    pairs = PairCrosstalk(down, right, zeros, zeros, zeros)
    found = fit_crosstalk(pairs._replace(probability=modelled(LIGHT, pairs)))
    for name in ("mean_fired_neighbors", "diagonal", "distance_two", "distance_three"):
        assert getattr(found, name) == pytest.approx(getattr(LIGHT, name), rel=1e-12)


def test_pairs_without_neighbors_are_refused():
    pair = PairCrosstalk(*(np.array([2]),) * 2, *(np.array([1.0]),) * 3)
    with pytest.raises(ValueError, match="give pairs at a distance of 1"):
        fit_crosstalk(pair)


@pytest.mark.parametrize(("array", "edge"), [(1, 1.03e-3), (2, 9.2e-4)])
def test_crosstalk_of_edge_neighbors_is_the_published_one(array, edge):
    arrays = Path(__file__).parents[3] / "docs/public_arrays"
    found = fit_crosstalk(read_measurement(arrays / f"crosstalk-{array}.csv"))
    shares = 1 + found.diagonal + found.distance_two + found.distance_three
    # the paper gives two digits
    assert found.mean_fired_neighbors / (4 * shares) == pytest.approx(edge, rel=0.01)
