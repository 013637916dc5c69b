"""Each noise term and each detector has its theory: source, limits, picture, code and test."""

import re
from typing import get_args

import pytest

from megalopta.flow import METHODS
from megalopta.sensor import Sensor
from megalopta.sensor.effects.base import Effect

from .pages import DOCS

PAGES = {page.stem: page.read_text("utf-8") for page in sorted(DOCS.glob("theory/*.md"))}
LAWS = {name: text for name, text in PAGES.items() if name != "index"}
SECTIONS = [
    pytest.param(section, id=section.partition("\n")[0].lstrip("# "))
    for text in LAWS.values()
    for section in re.split(r"^(?=##? )", text, flags=re.MULTILINE)
    if "Code and test" in section
]


def effects():
    """Classes of what acts in a sensor: every effect, every counter."""
    for field in Sensor.model_fields.values():
        for kind in get_args(field.annotation) or (field.annotation,):
            if isinstance(kind, type) and issubclass(kind, Effect):
                yield kind.__name__


@pytest.mark.parametrize("effect", sorted(set(effects())))
def test_theory_tells_of_every_effect(effect):
    assert any(f".{effect}`" in text for text in LAWS.values())


@pytest.mark.parametrize("name", METHODS)
def test_theory_tells_of_every_detector(name):
    module = "/".join(type(METHODS[name]).__module__.split(".")[1:])
    page = next((text for text in LAWS.values() if f"`{module}.py`" in text), "")
    assert re.search(rf"(?<!\w){re.escape(name)}(?!\w)", page)


@pytest.mark.parametrize("section", SECTIONS)
def test_a_law_has_source_and_limits(section):
    assert "\nSource\n: " in section
    assert "\nLimits\n: " in section


@pytest.mark.parametrize("text", [pytest.param(text, id=name) for name, text in LAWS.items()])
def test_a_page_of_theory_has_equations_and_a_picture(text):
    assert "$$" in text
    pictures = re.findall(r"sphx_glr_(plot_\w+?)_\d+\.png", text)
    assert pictures
    assert all((DOCS / "gallery" / f"{name}.py").exists() for name in pictures)
