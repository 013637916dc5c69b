import numpy as np
import pytest

from megalopta.assets_gen.tileable_noise import Marks, strew

SHAPE, SIZE_M = (400, 400), (1.0, 1.0)


def marks(count, lengths_m=(0.4, 0.4), aspect=0.5, seed=0):
    rng = np.random.default_rng(seed)
    return strew(SHAPE, SIZE_M, count, Marks(lengths_m, aspect, 0.3, 0.0), rng)


@pytest.mark.parametrize("seed", range(5))
def test_one_mark_covers_two_thirds_of_width_times_length_even_across_the_seam(seed):
    area = np.mean(np.isfinite(marks(1, seed=seed)))
    # the outline is two parabolas; counting texels of 2.5 mm is good to a percent of 400 mm
    assert area == pytest.approx(2 / 3 * 0.4 * 0.2, rel=0.01)


def test_marks_cover_as_independent_places_do():
    area = np.mean(np.isfinite(marks(400, (0.1, 0.1))))
    expected = 1 - np.exp(-400 * 2 / 3 * 0.1 * 0.05)
    # coverage of 400 independent marks on the torus: standard deviation below 0.01
    assert area == pytest.approx(expected, abs=0.05)
