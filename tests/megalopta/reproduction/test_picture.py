import csv
import json

import numpy as np
import pytest

from megalopta.reproduction.picture import Figure, write_figure


def draw(canvas):
    axes = canvas.subplots()
    axes.plot([0, 1], [0, 2], label="line")
    axes.set_xlabel("Time (s)")
    axes.legend()


EXAMPLE = Figure(
    name="example",
    title="An example",
    caption="What it shows. " * 20,
    draw=draw,
    numbers={"time_s": (0.0, 1.0), "name": ("a, b", "c"), "output_v": np.array([1 / 3, np.nan])},
)


def test_numbers_survive_both_files(tmp_path):
    *_, path, record = write_figure(EXAMPLE, tmp_path)
    assert json.loads(record.read_text("utf-8"))["rows"] == [[0.0, "a, b", 1 / 3], [1.0, "c", None]]
    with path.open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    assert tuple(head) == EXAMPLE.columns
    assert rows[0][1] == "a, b"
    assert float(rows[0][2]) == pytest.approx(1 / 3, rel=1e-8)
    assert np.isnan(float(rows[1][2]))


def test_same_figure_gives_the_same_bytes(tmp_path):
    first, second = (write_figure(EXAMPLE, tmp_path / name) for name in "ab")
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()


def test_columns_of_unequal_length_are_refused():
    with pytest.raises(ValueError, match="differ in length"):
        Figure("x", "", draw, {"a": (1.0,), "b": (1.0, 2.0)})
