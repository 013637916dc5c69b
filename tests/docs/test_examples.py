"""Examples in docstrings of public functions, run as they stand."""

import doctest
import importlib

import numpy as np
import pytest

LIBRARIES = ("megalopta", *(f"megalopta.{n}" for n in ("scenes", "render", "sensor", "flow")))
FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


def examples():
    for library in LIBRARIES:
        module = importlib.import_module(library)
        for name in module.__dir__():
            thing = getattr(module, name)
            home = importlib.import_module(getattr(thing, "__module__", None) or library)
            names = {**vars(home), "np": np}
            for test in doctest.DocTestFinder(recurse=False).find(thing, name, globs=names):
                if test.examples:
                    yield pytest.param(test, id=f"{library}.{name}")


@pytest.mark.parametrize("example", list(examples()))
def test_an_example_prints_what_it_says(example, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    told = []
    result = doctest.DocTestRunner(optionflags=FLAGS).run(example, out=told.append)
    assert not result.failed, "".join(told)
