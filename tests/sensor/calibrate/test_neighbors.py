"""Single estimators against closed forms and exact laws."""

import numpy as np
import pytest
from scipy.stats import poisson

from megalopta.sensor.calibrate.device import garwood_interval
from megalopta.sensor.calibrate.neighbors import neighbor_kernel
from megalopta.sensor.effects import crosstalk
from megalopta.sensor.effects.crosstalk import Crosstalk


@pytest.mark.parametrize("counts", [0, 1, 7, 300])
def test_garwood_ends_have_tails_of_a_fortieth(counts):
    low, high = garwood_interval(counts)
    assert poisson.cdf(counts, high) == pytest.approx(0.025, rel=1e-9)
    if counts:
        assert poisson.sf(counts - 1, low) == pytest.approx(0.025, rel=1e-9)


@pytest.mark.parametrize("probability", [0.0, 0.1])
def test_crosstalk_kernel(probability):
    rng = np.random.default_rng(3)
    primaries = rng.poisson(20.0, (1500, 16, 16))
    effect = Crosstalk(mean_fired_neighbors=probability)
    counts = np.array([crosstalk.spread(rng, frame, effect) for frame in primaries])
    kernel = neighbor_kernel(counts, np.ones((16, 16), bool))
    # orthogonal shares a quarter each; edges see less, which is below the error; 5 standard errors
    truth = np.array([probability / 4] * 2 + [0.0] * 4)
    assert np.all(np.abs(kernel.share - truth) < 5 * kernel.error + 0.03 * probability / 4)
    assert kernel.is_seen == (probability > 0)
    assert abs(kernel.afterpulses) < 5 * kernel.afterpulses_error + 0.002
