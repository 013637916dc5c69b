"""YAML as users write it, the mistakes in it, and settings as the help lists them."""

import pytest

from megalopta.config import yaml_model
from megalopta.config.model import load, parse
from megalopta.core.errors import UserError
from megalopta.core.validation import checked


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("camera: {width: true}", "camera.width"),
        ("trajectory: {up: [0, false, true]}", "trajectory.up.1"),
        ("scene: {kind: forest, mix: {beech: true}}", "scene.mix.beech"),
    ],
)
def test_a_boolean_is_no_number(text, place):
    with pytest.raises(UserError, match=f"{place}: .*give a"):
        parse(text, "my.yaml")


@pytest.mark.parametrize("path", ["camera.width.a", "camera.width.a.b", "seed.0", "name.0.x"])
def test_a_path_that_leads_nowhere_is_refused(path):
    with pytest.raises(UserError, match=f"--{path}: "):
        load("grating", {path: "1"})


def test_values_of_file_and_command_line_are_validated_once(monkeypatch):
    calls = []
    monkeypatch.setattr(yaml_model, "checked", lambda *given: calls.append(1) or checked(*given))
    load(
        "demo", {"scene.trees": "300", "sensors.0.exposure_s": "0.01", "light_levels": "starlight"}
    )
    assert len(calls) == 1
