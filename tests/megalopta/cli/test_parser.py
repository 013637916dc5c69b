import pytest

from megalopta.cli.main import joined, program, split_overrides
from megalopta.cli.settings import VerbSettings, description
from megalopta.core.errors import UserError

OWN = ("--out", "--redo")
DEMO = VerbSettings().takes


@pytest.mark.parametrize(
    ("words", "own", "settings"),
    [
        ("demo --scene.trees 50 --out=there --redo --camera.fov-deg=60", "demo --out=there --redo",
         {"scene.trees": "50", "camera.fov_deg": "60"}),
        ("--scene.trees=200 my.yaml", "my.yaml", {"scene.trees": "200"}),
        ("--sensors.0.dead-time.dead-time-s 1e-6 my.yaml", "my.yaml",
         {"sensors.0.dead_time.dead_time_s": "1e-6"}),
        ("--render.bands-nm.0.1 500 my.yaml", "my.yaml", {"render.bands_nm.0.1": "500"}),
        ("--methods 1 2 3 --out there", "--out there", {"methods": "[1, 2, 3]"}),
        ("--benchmark.sizes 1 2 --out there", "--out there", {"benchmark.sizes": "[1, 2]"}),
        ("--correct demo", "demo", {"correct": "true"}),
        ("--correct false demo", "demo", {"correct": "false"}),
        ("--correct=false demo", "demo", {"correct": "false"}),
        ("--correct --out there demo", "--out there demo", {"correct": "true"}),
    ],
)  # fmt: skip
def test_settings_take_their_words_and_leave_the_rest(words, own, settings):
    assert split_overrides(words.split(), OWN, DEMO) == (own.split(), settings)


def test_values_of_a_list_are_joined_by_commas_or_blanks(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").mkdir()
    words = "--photons 1 3,10 data --methods BM DIS √ --draws 2 more".split()
    lists = {"--photons", "--methods"}
    expected = "--photons 1,3,10 data --methods BM,DIS,√ --draws 2 more".split()
    assert joined(words, lists) == expected
    for typed in ("--methods BM,DIS PF", "--methods BM DIS PF", "--methods BM,DIS,PF"):
        (text,) = split_overrides(typed.split(), OWN, DEMO)[1].values()
        assert text.replace(", ", ",") == "[BM,DIS,PF]"


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
            assert split_overrides(words, command.named, command.takes)[0] == [name]


@pytest.mark.parametrize(
    "words", ["benchmark pairs a b c", "benchmark submit a b", "spadcam compare a --device b"]
)
def test_a_file_to_write_is_no_folder(words, tmp_path, refused):
    told = refused(*words.split(), "--out", tmp_path)
    assert "is a folder; give the name of a file" in told
