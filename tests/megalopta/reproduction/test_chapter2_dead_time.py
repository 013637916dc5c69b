import numpy as np
import pytest

from megalopta.reproduction.drawing import write_figure


@pytest.mark.slow
def test_figure_is_drawn_with_its_numbers(made, tmp_path, check_words):
    figure = made("fig-2.2")
    check_words(figure)
    assert all(path.stat().st_size for path in write_figure(figure, tmp_path))


def test_counts_end_at_one_per_dead_time_and_with_paralysis_at_that_over_e(made):
    curves = made("fig-2.2").numbers
    # at 1e10 photons per second and 1e-7 s the ceiling is reached to a thousandth
    assert curves["nonparalyzable_100_ns_hz"][-1] == pytest.approx(1e7, rel=2e-3)
    assert curves["paralyzable_100_ns_hz"].max() == pytest.approx(1e7 / np.e, rel=2e-3)
