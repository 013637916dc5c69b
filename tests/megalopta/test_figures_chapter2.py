import numpy as np
import pytest

from megalopta.figures_chapter2 import (
    ANODE_V,
    CHAPTER_2,
    dark_density,
    measure_row,
    measured_efficiency,
)
from megalopta.reproduce import write_figure
from megalopta.sensor.presets import TABLE_2_1


@pytest.mark.parametrize("name", CHAPTER_2)
def test_figure_is_drawn_with_its_numbers(name, tmp_path):
    figure = CHAPTER_2[name]()
    assert figure.name == name
    paths = write_figure(figure, tmp_path)
    assert [path.suffix for path in paths] == [".png", ".svg", ".csv", ".json"]
    assert paths[2].read_text("utf-8").count("\n") == len(figure.rows) + 1


@pytest.mark.parametrize(
    ("name", "printed"),
    [
        ("fig-2.9", ("1.77", "0.93", "11 of 16", "0.71", "0.63", "0.32")),
        ("fig-2.10", ("13.68 V", "nearly all")),
        ("fig-2.11", ("150 mV", "42 mV", "below 1 %")),
    ],
)
def test_caption_has_what_the_dissertation_prints(name, printed):
    # §2.4.4, §2.4.5 and §2.4.7
    caption = CHAPTER_2[name]().caption
    assert [number for number in printed if number not in caption] == []


def test_every_pixel_counts_at_every_bias_measured():
    assert np.all(measure_row().dark > 0)


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


def test_table_agrees_with_its_printed_densities():
    rows = {row[0]: row for row in CHAPTER_2["table-2.1"]().rows}
    assert list(rows) == list(TABLE_2_1)
    for row in rows.values():
        # printed with two digits; counting 1600 pixels for 4 s is good to 0.5 %
        assert row[6] == pytest.approx(row[5], rel=0.025)
        assert row[8] == pytest.approx(row[7], rel=0.01)
