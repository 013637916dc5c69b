"""Causes of a difference and their sizes."""

import numpy as np
import pytest

from megalopta.sensor import changed, preset
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.model import Model
from megalopta.sensor.compare.recordings import compare_recordings

SHAPE = (24, 24)
RATES_HZ = np.full((1, *SHAPE), 3e4)
SENSOR = changed(preset("ideal"), exposure_s=1e-3)


def drawn(sensor, seed, frames=400):
    """A level of even light."""
    like = Model(sensor, [RATES_HZ])
    return like.drawn([level(frames)], seed)


def level(frames):
    return Level(np.zeros((frames, *SHAPE), np.uint16), 1e-3, 3e4)


@pytest.mark.parametrize(
    "shares",
    [
        {"distance_two": 0.5, "distance_three": 1.0},
        pytest.param(
            {"kernel": [[np.where(np.arange(25) == 12, 0.0, 1.0).reshape(5, 5).tolist()]]},
            marks=pytest.mark.slow,
        ),
    ],
)
def test_crosstalk_of_any_kernel_is_found_with_its_size(shares):
    known = changed(SENSOR, crosstalk={"mean_fired_neighbors": 0.02, **shares})
    other = changed(known, crosstalk={"mean_fired_neighbors": 0.12})
    found = compare_recordings(drawn(other, 1), drawn(known, 2), Model(known, [RATES_HZ]))
    assert found.explained.accepted[0].names == ("crosstalk",)
    # known to about 4 %, five of which; means, variances and covariances agree
    assert found.causes[0].captured == pytest.approx(0.12, rel=0.2)
