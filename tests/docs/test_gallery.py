"""Scripts of the gallery run as they stand, and end with a picture."""

import runpy

import pytest

from .pages import DOCS

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
