"""Each public name has an example: a page, a script of the gallery, a test, or code that uses it."""

import sys
from importlib import import_module

import pytest

from .pages import DOCS


@pytest.fixture(scope="module")
def uses():
    sys.path.insert(0, str(DOCS / "extensions"))
    yield import_module("uses")
    sys.path.remove(str(DOCS / "extensions"))


def test_no_public_name_is_without_an_example(uses):
    shown = uses.examples()
    without = [
        f"{room}.{name}" for key, (room, name, _) in uses.public().items() if key not in shown
    ]
    assert not without, without


def test_an_example_names_what_it_shows_or_what_gives_it(uses):
    key = next(key for key, (_, name, _) in uses.public().items() if name == "detection_rate")
    use = uses.examples()[key]
    assert "detection_rate" in (uses.ROOT / use.path).read_text("utf-8")
