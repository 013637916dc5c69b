"""YAML as users write it, and the mistakes in it."""

import pytest

from megalopta.benchmark.sweep import Sweep
from megalopta.config.model import load, parse
from megalopta.config.yaml_model import mapping, validated
from megalopta.core.errors import UserError


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name: a\nseed: 1\nname: b\n", "the key 'name' comes twice; leave one out .line 3"),
        ("camera:\n  width: 4\n  height: 4\n  width: 5\n", "the key 'width' comes twice.*line 4"),
        ("camera: {width: 4, width: 4}", "the key 'width' comes twice"),
        ("camera: {width: !!int x}", "'x' is no int .line 1"),
        ("seed: " + "9" * 5000, "is no int"),
        ("[" * 1000, "nested too deeply; write it flatter"),
        ("name: [", "not valid YAML: while parsing a flow"),
        ("scene: !!python/object:os.system {}", "could not determine a constructor"),
        ("name: \x00", "not valid YAML"),
    ],
)
def test_what_is_no_yaml_is_told_with_its_line(text, message):
    with pytest.raises(UserError, match=f"my.yaml: not valid YAML: .*{message}|{message}"):
        parse(text, "my.yaml")


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("camera: {width: true}", "camera.width"),
        ("camera: {fov_deg: TRUE}", "camera.fov_deg"),
        ("light_levels: [2, true]", "light_levels.1"),
        ("trajectory: {up: [0, false, true]}", "trajectory.up.1"),
        (
            "{trajectory: {frame_rate_hz: 1}, sensors: [{preset: ideal, exposure_s: true}]}",
            "sensors.0.exposure_s",
        ),
        ("scene: {kind: forest, mix: {beech: true}}", "scene.mix.beech"),
        ("seed: false", "seed"),
    ],
)
def test_a_boolean_is_no_number(text, place):
    with pytest.raises(UserError, match=f"{place}: .*give a"):
        parse(text, "my.yaml")


def test_a_boolean_on_the_command_line_is_no_number():
    with pytest.raises(UserError, match=r"camera.width: true and false are no numbers"):
        load("grating", {"camera.width": "true"})


def test_a_boolean_is_no_number_to_a_sweep():
    with pytest.raises(UserError, match=r"values: true is no number"):
        validated(Sweep, mapping("values: [true, 5]", "s"), "s")


def test_booleans_are_booleans_and_text_of_a_number_is_one():
    sweep = validated(Sweep, mapping("{vary: blurred, values: [true, false]}", "s"), "s")
    assert [trial.blurred for trial in sweep.trials] == [True, False]
    assert parse("camera: {fov_deg: 6e1}", "my.yaml").camera.fov_deg == 60


def test_one_mapping_may_stand_in_several_places():
    text = "objects: [&box {name: a, position_m: [5, 0, 1]}, {<<: *box, name: b}]"
    assert [thing.name for thing in parse(text, "my.yaml").objects] == ["a", "b"]


def test_a_long_value_is_cut_in_the_message():
    text = "camera: " + "x" * 100_000
    with pytest.raises(UserError) as refused:
        parse(text, "my.yaml")
    assert len(str(refused.value)) < 300


@pytest.mark.parametrize("path", ["camera.width.a", "camera.width.a.b", "seed.0", "name.0.x"])
def test_a_path_that_leads_nowhere_is_refused(path):
    with pytest.raises(UserError, match=f"--{path}: "):
        load("grating", {path: "1"})


def test_a_method_named_twice_is_refused():
    with pytest.raises(UserError, match="methods: BM is named twice"):
        load("demo", {"methods": "[BM, BM]"})
