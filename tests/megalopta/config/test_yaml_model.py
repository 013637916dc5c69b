"""YAML as users write it, the mistakes in it, and settings as the help lists them."""

from itertools import pairwise

import numpy as np
import pytest

from megalopta.cli.settings import VerbSettings
from megalopta.config import yaml_model
from megalopta.config.measuring import FlowSettings
from megalopta.config.model import Configuration, load, parse
from megalopta.config.recipe import Plan
from megalopta.config.schema import schema_of
from megalopta.core.errors import UserError
from megalopta.core.validation import checked


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("camera: {width: true}", "camera.width"),
        ("light_levels: [2, true]", "light_levels.1"),
        ("trajectory: {up: [0, false, true]}", "trajectory.up.1"),
        ("scene: {kind: forest, mix: {beech: true}}", "scene.mix.beech"),
        ("seed: false", "seed"),
    ],
)
def test_a_boolean_is_no_number(text, place):
    with pytest.raises(UserError, match=f"{place}: .*give a"):
        parse(text, "my.yaml")


def test_values_of_file_and_command_line_are_validated_once(monkeypatch):
    calls = []
    monkeypatch.setattr(yaml_model, "checked", lambda *given: calls.append(1) or checked(*given))
    load(
        "demo", {"scene.trees": "300", "sensors.0.exposure_s": "0.01", "light_levels": "starlight"}
    )
    assert len(calls) == 1


@pytest.mark.parametrize("model", [Configuration, Plan])
def test_schemas_state_every_field_with_its_meaning(model):
    fields = schema_of(model)["properties"]
    assert fields.keys() == model.model_fields.keys()
    assert all(field.get("description") or "$ref" in field for field in fields.values())


def test_text_of_a_number_is_one():
    assert parse("camera: {fov_deg: 6e1}", "my.yaml").camera.fov_deg == 60


@pytest.mark.parametrize("path", ["camera.width.a", "camera.width.a.b", "seed.0", "name.0.x"])
def test_a_path_that_leads_nowhere_is_refused(path):
    with pytest.raises(UserError, match=f"--{path}: "):
        load("grating", {path: "1"})


def test_help_lists_every_setting_with_a_meaning():
    text = VerbSettings().help()
    entries = [line for line in text.splitlines() if line.startswith("  --")]
    meanings = [line for line in text.splitlines() if line.startswith("      ")]
    assert len(entries) > 50
    assert len(meanings) >= len(entries)
    assert not [
        a for a, b in pairwise(text.splitlines()) if a.startswith("  --") and b.startswith("  --")
    ]
    assert any(line.startswith("  --camera.fov-deg 75") for line in entries)
    assert "(degrees)" in text


PURITY = np.array([0.0, 0.4, 0.75, 1.0])


@pytest.mark.parametrize(
    ("mixed", "weights"),
    [("score", None), ("leave_out", [0, 0, 1, 1]), ("weigh", PURITY.tolist())],
)
def test_pixels_count_as_the_setting_says(mixed, weights):
    found = FlowSettings(mixed=mixed).weights(PURITY)
    assert found is None if weights is None else found.tolist() == weights
