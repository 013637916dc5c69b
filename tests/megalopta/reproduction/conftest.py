from functools import cache

import pytest

from megalopta.plotting.style import house_style, new_canvas
from megalopta.reproduction.drawing import Run, find


@pytest.fixture(scope="session")
def made():
    """A figure by its name, that rests on no trials; made once."""

    @cache
    def make(name):
        (recipe,) = find(name)
        return recipe.make(Run())

    return make


@pytest.fixture(scope="session")
def drawn(made, check_words):
    """The same, drawn once; what its files hold is tested on one example."""

    def draw(name):
        figure = made(name)
        assert figure.name == name
        check_words(figure)
        assert {len(row) for row in figure.rows} == {len(figure.columns)}
        with house_style():
            canvas = new_canvas(figure.title, figure.caption, figure.height_in)
            figure.draw(canvas)
            canvas.draw_without_rendering()
        return figure

    return draw
