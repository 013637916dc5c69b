import numpy as np
import pytest

from megalopta.reproduction.chapter2_pixel_row import (
    ANODE_V,
    dark_density,
    measure_row,
    measured_efficiency,
)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fig-2.9", "fig-2.10", "fig-2.11", "fig-2.12"])
def test_figure_is_drawn_with_its_numbers(drawn, name):
    drawn(name)


def test_quiet_pixels_of_the_table_are_those_drawn(made):
    figure = made("fig-2.9")
    rates = np.array(figure.rows)[np.isclose([row[0] for row in figure.rows], 13.58), 1:].ravel()
    ours, _ = figure.printed["Pixels below 1.5 Hz/µm²"]
    assert ours == f"{np.sum(rates < 1.5)} of 16"


def test_efficiency_stays_below_one_percent_wherever_it_was_measured():
    # the mean of 500 frames of at most 320 counts is good to 0.005 %
    assert 0.0085 < np.nanmax(measured_efficiency(measure_row())) < 0.01


def test_dark_counts_rise_with_bias_until_the_counter_is_full():
    density = dark_density(measure_row())
    assert np.all(np.diff(np.nan_to_num(density).mean(axis=1)) > 0)
    # 319 or 320 counts in 0.1 s on 360 µm²
    assert np.nanmax(density) == pytest.approx(8.87, abs=0.03)


def test_best_ratio_is_at_a_lower_bias_than_the_best_efficiency():
    row = measure_row()
    efficiency = measured_efficiency(row)
    ratio = efficiency / dark_density(row)
    best, most = (ANODE_V[np.nanargmax(each, axis=0)] for each in (ratio, efficiency))
    assert np.all(best <= most)
    assert np.mean(best < most) > 0.8
