"""Examples: each public name has one, the gallery runs, and a release is told of alike."""

import re
import runpy
import sys
from importlib import import_module
from importlib.metadata import version

import pytest
import yaml

import megalopta

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


SCRIPTS = sorted(DOCS.glob("gallery/plot_*.py"))


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_script_shows_one_picture(script, monkeypatch):
    plt = pytest.importorskip("matplotlib.pyplot")
    plt.switch_backend("agg")
    shown = []
    monkeypatch.setattr(plt, "show", lambda: shown.append(plt.get_fignums()))
    runpy.run_path(str(script))
    plt.close("all")
    assert [len(figures) for figures in shown] == [1]


def test_a_script_has_one_idea_in_at_most_forty_lines():
    lengths = {script.name: len(script.read_text("utf-8").splitlines()) for script in SCRIPTS}
    assert lengths
    assert max(lengths.values()) <= 40, lengths


def test_the_citation_names_the_newest_version_of_the_changelog():
    citation = yaml.safe_load((DOCS.parent / "CITATION.cff").read_text("utf-8"))
    changes = (DOCS.parent / "CHANGELOG.md").read_text("utf-8")
    assert str(citation["version"]) == re.search(r"^## ([\d.]+)", changes, re.MULTILINE)[1]


def test_the_program_has_the_version_of_its_installation():
    assert megalopta.__version__ == version("megalopta")
