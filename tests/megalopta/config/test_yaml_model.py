"""YAML as users write it, the mistakes in it, and settings as the help lists them."""

import pytest

from megalopta.config.model import load, parse
from megalopta.core.errors import UserError


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


def test_text_of_a_number_is_one():
    assert parse("camera: {fov_deg: 6e1}", "my.yaml").camera.fov_deg == 60


@pytest.mark.parametrize("path", ["camera.width.a", "camera.width.a.b", "seed.0", "name.0.x"])
def test_a_path_that_leads_nowhere_is_refused(path):
    with pytest.raises(UserError, match=f"--{path}: "):
        load("grating", {path: "1"})
