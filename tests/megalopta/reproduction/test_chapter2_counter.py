import numpy as np
import pytest

from megalopta.reproduction.chapter2_counter import (
    LIGHT_HZ,
    ROW,
    spadcam_with_step,
    straightness,
    transient,
    volts_per_event,
)
from megalopta.reproduction.drawing import write_figure
from megalopta.sensor.spad.fixed_pattern import draw_fixed_pattern
from megalopta.sensor.spad.presets import TABLE_2_1

BOTTOM_V = 0.1
STEPS = pytest.mark.parametrize("step_v", [10e-3, 30e-3])


@pytest.mark.parametrize("name", ["fig-2.7", "fig-2.8"])
def test_figure_is_drawn_with_its_numbers(drawn, name):
    drawn(name)


@STEPS
def test_counter_is_as_straight_as_the_dissertation_says_over_the_whole_swing(step_v):
    row = transient(spadcam_with_step(step_v))
    over_events, _ = straightness(row, BOTTOM_V)
    assert over_events.min() > 0.99
    # all pixels go through the whole swing
    assert np.all(row.output_v[:, -1] == pytest.approx(BOTTOM_V))


@STEPS
def test_output_falls_by_the_step_and_hardly_by_the_leak(step_v):
    # 7.2 mV/s for as long as it takes: some 20 µV per event at 300 events per second
    assert volts_per_event(transient(spadcam_with_step(step_v)), BOTTOM_V) == pytest.approx(
        step_v, abs=25e-6
    )


def test_row_sees_light_and_dark_counts_until_the_end_of_the_exposure():
    sensor = spadcam_with_step(10e-3)
    expected = sensor.exposure_s * (LIGHT_HZ + draw_fixed_pattern(sensor, ROW).dark_counts_hz[0])
    events = transient(sensor).events[:, -1]
    # Poisson; |z| < 6 in 16 pixels, false alarm 3e-8; dead time takes 0.3 % of the brightest
    assert np.all(np.abs(events - expected) < 6 * np.sqrt(expected) + 0.003 * expected)


def test_arrivals_by_chance_bend_the_output_over_time_as_a_random_walk():
    # a Poisson walk of n events leaves 1 − R² of 4/(5·n) on average about its own line, ± 62 %;
    # |z| < 5 of the mean of 16
    for step_v in (10e-3, 30e-3):
        _, over_time = straightness(transient(spadcam_with_step(step_v)), BOTTOM_V)
        assert 1 - over_time.mean() == pytest.approx(0.8 * step_v / 3.2, rel=0.8)


def test_counts_end_at_one_per_dead_time_and_with_paralysis_at_that_over_e(made):
    curves = made("fig-2.2").numbers
    # at 1e10 photons per second and 1e-7 s the ceiling is reached to a thousandth
    assert curves["nonparalyzable_100_ns_hz"][-1] == pytest.approx(1e7, rel=2e-3)
    assert curves["paralyzable_100_ns_hz"].max() == pytest.approx(1e7 / np.e, rel=2e-3)


def test_table_is_drawn_with_a_line_for_each_device(made, tmp_path, check_words):
    table = made("table-2.1")
    check_words(table)
    assert write_figure(table, tmp_path)[2].read_text("utf-8").count("\n") == len(TABLE_2_1) + 1


def test_table_agrees_with_its_printed_densities(made):
    rows = {row[0]: row for row in made("table-2.1").rows}
    assert list(rows) == list(TABLE_2_1)
    for row in rows.values():
        # printed with two digits; counting 1600 pixels for 4 s is good to 0.5 %
        assert row[6] == pytest.approx(row[5], rel=0.025)
        assert row[8] == pytest.approx(row[7], rel=0.01)
