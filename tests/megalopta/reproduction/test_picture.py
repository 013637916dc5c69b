import numpy as np
import pandas as pd

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
    numbers=pd.DataFrame(
        {"time_s": [0.0, 1.0], "name": ["a, b", "c"], "output_v": [1 / 3, np.nan]}
    ),
)


def test_same_figure_gives_the_same_bytes(tmp_path):
    first, second = (write_figure(EXAMPLE, tmp_path / name) for name in "ab")
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()
