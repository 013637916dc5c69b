import pytest

from megalopta.figures.recipe import Run
from megalopta.figures.registry import find


@pytest.fixture(scope="session")
def made():
    """A figure by its name, that rests on no trials."""

    def make(name):
        (recipe,) = find(name)
        return recipe.make(Run())

    return make
