import pytest

from megalopta.plotting.picture import write_figure
from megalopta.sensor.spad.presets import TABLE_2_1


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
