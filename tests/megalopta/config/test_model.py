import hashlib

import numpy as np
import pytest
import yaml

from megalopta.config import built_in_names
from megalopta.config.drawing import configuration_of
from megalopta.config.model import Configuration, differences, load, parse
from megalopta.config.recipe import load_plan
from megalopta.core.errors import UserError
from megalopta.scenes.forest.description import Forest
from megalopta.scenes.scene import Haze


@pytest.mark.parametrize("name", built_in_names())
def test_built_in_configurations_survive_yaml(name):
    configuration = load(name)
    assert parse(yaml.safe_dump(configuration.model_dump(mode="json")), "again") == configuration


def test_plans_and_configurations_are_told_apart(tmp_path):
    plan, single = tmp_path / "my plan.yaml", tmp_path / "single.yaml"
    plan.write_text("sequences: 2\nscenes: [{preset: grating}]\n")
    single.write_text("scene: {kind: grating}\n")
    with pytest.raises(UserError, match="make them with: megalopta dataset make '.*/my plan.yaml'"):
        load(str(plan))
    (tmp_path / "dataset.yaml").write_text("format: 1\nplan: {sequences: 2}\n")
    with pytest.raises(UserError, match="a dataset of many sequences; give"):
        load(str(tmp_path))
    with pytest.raises(UserError, match="make it with: megalopta render .*/single.yaml, or give"):
        load_plan(single)


def test_overrides_reach_nested_fields_and_list_items():
    overrides = {"sensors.0.exposure_s": "0.05", "light_levels": "[starlight, 0.5]"}
    changed = load("demo", overrides | {"scene.trees": "120", "methods": "BM"})
    assert changed.scene.trees == 120
    assert changed.sensors[0].exposure_s == 0.05
    assert changed.light_levels == ("starlight", 0.5)
    assert changed.methods == ("BM",)


def test_an_override_reaches_into_what_is_absent():
    hazy = load("demo", {"scene.haze.visibility_m": "99", "render.integrator": "auto"})
    assert hazy.scene.haze == Haze(visibility_m=99)
    trail = load(
        "demo",
        {"scene.haze.visibility_m": "99", "scene.preset": "trail", "render.integrator": "auto"},
    )
    assert trail.scene.haze == Haze(visibility_m=99)
    assert trail.scene.path_width_m > 0


def test_another_preset_starts_the_scene_afresh_in_whatever_order_it_is_given():
    changed = load("demo", {"scene.trees": "320", "scene.preset": "clearing"})
    assert changed.scene == Forest(preset="clearing", trees=320)
    assert load("demo", {"scene.preset": "null"}).scene == Forest()
    assert load("grating", {"scene.preset": "open", "scene.kind": "forest"}).scene == Forest(
        preset="open"
    )


def test_sensors_are_given_by_preset_with_changes():
    text = "sensors: [ideal, {preset: spadcam, name: cold, dark_counts: {bulk_mean_hz_um2: 0.1}}]"
    ideal, cold = parse(text, "x").sensors
    assert ideal.name == "ideal"
    assert cold.dark_counts.bulk_mean_hz_um2 == 0.1
    assert cold.dark_counts.hot_fraction > 0  # the rest of the preset stays
    assert cold.counter.capacity == 320


@pytest.fixture
def measured(tmp_path):
    np.save(tmp_path / "dark.npy", np.ones((4, 4)))
    device = {
        "preset": "spadcam",
        "name": "mine",
        "measured": {"dark_counts": {"path": "dark.npy"}},
    }
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(device))
    (tmp_path / "night.yaml").write_text(yaml.safe_dump({"sensors": ["mine.yaml"]}))
    (tmp_path / "inline.yaml").write_text(yaml.safe_dump({"sensors": [device]}))
    return tmp_path


@pytest.mark.parametrize("name", ["night.yaml", "inline.yaml"])
def test_measured_device_is_found_beside_the_configuration_and_hashed(measured, name):
    (sensor,) = load(str(measured / name)).sensors
    file = sensor.measured.dark_counts
    assert sensor.name == "mine"
    assert file.path == str(measured / "dark.npy")
    assert file.sha256 == hashlib.sha256((measured / "dark.npy").read_bytes()).hexdigest()


def test_missing_map_and_missing_device_are_named(measured):
    (measured / "dark.npy").unlink()
    with pytest.raises(
        UserError, match=r"measured\.dark_counts: .*dark\.npy cannot be read \(no such file"
    ):
        load(str(measured / "inline.yaml"))
    (measured / "mine.yaml").unlink()
    with pytest.raises(UserError, match=r"mine\.yaml: No such file or directory; give the path"):
        load(str(measured / "night.yaml"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("objects: [{shape: box, sise_m: [1, 1, 1]}]", r"objects\.0\.sise_m: unknown key; did you mean 'size_m'"),
        ("camrea: {}", "camrea: unknown key; did you mean 'camera'"),
        ("shutter: {exposure_s: 9}", r"shutter\.exposure_s 9 is longer than a frame"),
        ("sensors: [spadcan]", "'spadcan' is unknown; did you mean 'spadcam'"),
        ("trajectory: {position_m: [0, 0, 1], look_at_m: [0, 0, 5]}", "up .* is parallel to the view"),
        ("camera: {kind: fisheye}", "camera: kind 'fisheye' is unknown; use 'perspective', 'opencv', 'equirectangular'"),
        ("camera: {focus_m: 2}", r"camera: focus_m without aperture_mm: give both"),
        ("camera: {kind: cylindrical, aperture_mm: 9}", r"camera\.aperture_mm: unknown key"),
        ("camera: {kind: opencv, width: 8, height: 8, fx_px: 9, fy_px: 9, cx_px: 4, cy_px: 4, fisheye: [0, 0, 0, 0], aperture_mm: 9, focus_m: 1}", "aperture_mm: a fisheye has no plane in focus"),
        ("{scene: {kind: grating}, light: {sky: natural}}", r"light\.sky: a scene of kind 'grating' has its own light"),
        ("{scene: {kind: forest, haze: {visibility_m: 99}}, render: {integrator: baked}}", "integrator 'baked': baked light has no haze; use 'auto' or 'path'"),
        ("scene: {kind: forest, haze: {}}", r"scene\.haze\.visibility_m: missing; give a value"),
        ("scene: {trees: 5}", "missing key 'kind'; add it, one of forest, grating"),
        ("methods: [XX]", "'XX' is unknown: use some of BM"),
        ("sensors: [ideal, ideal]", "name of its own"),
        ("sensors: []", "sensors: empty; give at least one"),
        ("name: ../up", "cannot name a folder"),
        ("", "empty; give at least one key"),
        ("a: !!python/object/apply:os.system [ls]", "not valid YAML"),
    ],
)  # fmt: skip
def test_mistakes_get_one_sentence_with_field_and_remedy(text, message):
    with pytest.raises(UserError, match=message) as caught:
        parse(text, "file.yaml")
    assert "\n" not in str(caught.value)


def test_differences_name_every_changed_leaf():
    old = yaml.safe_load("a: {b: 1, c: [1, 2]}\nd: [{e: 1}]")
    new = yaml.safe_load("a: {b: 2, c: [1, 3]}\nd: [{e: 1}, {e: 2}]")
    assert differences(old, new) == ["a.b: 1 → 2", "a.c: [1, 2] → [1, 3]", "d.1.e: absent → 2"]
    assert differences(old, old) == []


def test_paths_of_light_are_as_long_as_the_kind_of_scene_needs(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 3\n")
    meshes = {"scene.kind": "meshes", "scene.files": str(tmp_path / "a.obj")}
    text = f"scene: {{kind: meshes, files: {tmp_path / 'a.obj'}}}\n"
    plan = tmp_path / "plan.yaml"
    plan.write_text("scenes: [{preset: demo, scene: {kind: meshes, files: a.obj}}]")
    assert [
        load("demo").render.max_depth,
        load("demo", meshes).render.max_depth,
        load("demo", meshes | {"render.max_depth": "7"}).render.max_depth,
        parse(text, "test", {"camera.width": "9"}).render.max_depth,
        parse(f"{text}render: {{max_depth: 5}}", "test", {"camera.width": "9"}).render.max_depth,
        configuration_of(load_plan(plan), 0).render.max_depth,
        Configuration().render.max_depth,
    ] == [4, 64, 7, 64, 5, 64, 16]
