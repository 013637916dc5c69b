from itertools import pairwise

import pytest

from megalopta.configuration import load
from megalopta.errors import UserError
from megalopta.overrides import settings_help, split_overrides

OWN = ("--out", "--redo")


def test_settings_are_told_from_own_options():
    words = "render demo --scene.trees 50 --out there --redo --camera.fov-deg=60".split()
    own, overrides = split_overrides(words, OWN)
    assert own == ["render", "demo", "--out", "there", "--redo"]
    assert overrides == {"scene.trees": "50", "camera.fov_deg": "60"}


def test_several_words_make_a_list_and_negative_numbers_are_values():
    _, overrides = split_overrides(["--light-levels", "starlight", "0.5", "--a", "-3"], OWN)
    assert overrides == {"light_levels": "[starlight, 0.5]", "a": "-3"}


def test_an_own_option_ends_a_setting_also_with_an_equals_sign():
    own, overrides = split_overrides(["demo", "--seed", "3", "--out=/x"], OWN)
    assert own == ["demo", "--out=/x"]
    assert overrides == {"seed": "3"}


def test_a_setting_given_twice_is_refused():
    with pytest.raises(UserError, match="--seed: given twice"):
        split_overrides(["--seed", "1", "--seed", "2"], OWN)


def test_a_setting_without_value_is_refused():
    with pytest.raises(UserError, match="--scene.trees: needs a value"):
        split_overrides(["--scene.trees"], OWN)


def test_help_lists_every_setting_with_a_meaning():
    text = settings_help(load("demo"))
    entries = [line for line in text.splitlines() if line.startswith("  --")]
    meanings = [line for line in text.splitlines() if line.startswith("      ")]
    assert len(entries) > 50
    assert len(meanings) >= len(entries)
    assert not [
        a for a, b in pairwise(text.splitlines()) if a.startswith("  --") and b.startswith("  --")
    ]
    assert any(line.startswith("  --camera.fov-deg 75") for line in entries)
