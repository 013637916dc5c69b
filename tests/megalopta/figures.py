"""Figures: made once, drawn, and what their words keep to."""

import re
from functools import cache

from megalopta.plotting.style import house_style, new_canvas
from megalopta.reproduction.drawing import Run, find


def check_words(figure):
    """Refuse a figure without the dissertation's number, or with a caption of over 3 sentences."""
    number = re.fullmatch(r"(fig|table)-(\d+\.\d+)", figure.name)
    if number:
        kind = {"fig": "Figure", "table": "Table"}[number[1]]
        assert figure.title.startswith(f"{kind} {number[2]}: ")
    sentences = re.findall(r"(?<!Eq)[.?!](?= [A-Z(]|$)", figure.caption)
    assert 1 <= len(sentences) <= 3


def canvas_of(figure):
    """The figure, drawn; what its files hold is tested on one example."""
    check_words(figure)
    with house_style():
        canvas = new_canvas(figure.title, figure.caption, figure.height_in)
        figure.draw(canvas)
        canvas.draw_without_rendering()
    return canvas


@cache
def made(name):
    """A figure by its name, that rests on no trials."""
    (recipe,) = find(name)
    figure = recipe.make(Run())
    assert figure.name == name
    assert {len(row) for row in figure.rows} == {len(figure.columns)}
    return figure
