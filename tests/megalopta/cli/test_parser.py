import pytest

from megalopta.cli.main import program, split_overrides
from megalopta.cli.settings import VerbSettings, description
from megalopta.core.errors import UserError

OWN = ("--out", "--redo")
DEMO = VerbSettings().takes


def test_settings_are_told_from_own_options():
    words = "render demo --scene.trees 50 --out=there --redo --camera.fov-deg=60".split()
    own, overrides = split_overrides(words, OWN, DEMO)
    assert own == ["render", "demo", "--out=there", "--redo"]
    assert overrides == {"scene.trees": "50", "camera.fov_deg": "60"}


@pytest.mark.parametrize(
    "setting",
    [
        ["--scene.trees", "200"],
        ["--scene.trees=200"],
        ["--sensors.0.dead-time.dead-time-s", "1e-6"],
        ["--render.bands-nm.0.1", "500"],
        ["--scene.mix.beech", "1"],
    ],
)
def test_a_single_value_takes_one_word(setting):
    own, overrides = split_overrides(["render", *setting, "my.yaml"], OWN, DEMO)
    assert own == ["render", "my.yaml"]
    assert len(overrides) == 1


@pytest.mark.parametrize(
    "setting", ["methods", "light-levels", "benchmark.sizes", "trajectory.up", "sensors"]
)
def test_a_list_takes_all_words_up_to_the_next_option(setting):
    words = ["demo", f"--{setting}", "1", "2", "3", "--out", "there"]
    own, overrides = split_overrides(words, OWN, DEMO)
    assert own == ["demo", "--out", "there"]
    assert list(overrides.values()) == ["[1, 2, 3]"]


@pytest.mark.parametrize(
    ("words", "value"),
    [
        (["--correct", "demo"], "true"),
        (["demo", "--correct"], "true"),
        (["--correct", "false", "demo"], "false"),
        (["--correct=false", "demo"], "false"),
        (["--correct", "--out", "there", "demo"], "true"),
    ],
)
def test_a_switch_takes_true_or_false_and_nothing_else(words, value):
    own, overrides = split_overrides(words, OWN, DEMO)
    assert "demo" in own
    assert overrides == {"correct": value}


@pytest.mark.parametrize(
    ("words", "told"),
    [("--seed 1 --seed 2", "--seed: given twice"), ("--scene.trees", "--scene.trees: missing val")],
)
def test_a_setting_has_one_value(words, told):
    with pytest.raises(UserError, match=told):
        split_overrides(words.split(), OWN, DEMO)


@pytest.mark.parametrize("typed", ["--ouut", "--ot=x", "--reddo", "--rdo"])
def test_a_mistyped_option_is_told_the_one_that_was_meant(typed):
    meant = "--redo" if "d" in typed else "--out"
    with pytest.raises(UserError, match=f"no such option; did you mean {meant}?"):
        split_overrides(["demo", typed], OWN, DEMO)


def test_no_setting_is_taken_for_a_mistyped_option():
    for name, command in program().verbs.items():
        for field in (
            description()["models"][command.settings.models[0]] if command.settings else ()
        ):
            words = [name, f"--{field.replace('_', '-')}=1"]
            assert split_overrides(words, command.options, command.takes)[0] == [name]


@pytest.mark.parametrize(
    "words",
    ["benchmark pairs a b c", "benchmark submit a b", "spadcam compare a --device b"],
)
def test_a_file_to_write_is_no_folder(words, tmp_path, refused):
    told = refused(*words.split(), "--out", tmp_path)
    assert "is a folder; give the name of a file" in told
