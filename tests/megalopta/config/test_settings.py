"""Settings of the command line, as its help lists them."""

from itertools import pairwise

from megalopta.config.model import load
from megalopta.config.settings import Settings


def test_help_lists_every_setting_with_a_meaning():
    text = Settings(load("demo")).help()
    entries = [line for line in text.splitlines() if line.startswith("  --")]
    meanings = [line for line in text.splitlines() if line.startswith("      ")]
    assert len(entries) > 50
    assert len(meanings) >= len(entries)
    assert not [
        a for a, b in pairwise(text.splitlines()) if a.startswith("  --") and b.startswith("  --")
    ]
    assert any(line.startswith("  --camera.fov-deg 75") for line in entries)


def test_help_lists_the_fields_that_are_asked_for():
    text = Settings(load("demo"), ("light_levels", "sensors")).help()
    entries = [line for line in text.splitlines() if line.startswith("  --")]
    assert entries
    assert all(line.startswith(("  --light-levels", "  --sensors")) for line in entries)
