"""A file names what lies in its own folder, and nothing else; users name what they like."""

import pytest

from megalopta.config.model import Configuration, load, parse
from megalopta.config.recipe import load_plan
from megalopta.core.errors import UserError
from megalopta.core.named_file import named_path
from megalopta.sensor import load_sensor

SECRET = "hunter2 is the password\n"


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder of somebody else's files, with a secret outside of it, to which a link leads."""
    (tmp_path / "secret.csv").write_text(SECRET)
    folder = tmp_path / "stranger"
    folder.mkdir()
    (folder / "link.csv").symlink_to(tmp_path / "secret.csv")
    (folder / "loop.csv").symlink_to(folder / "loop.csv")
    (folder / "x.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (folder / "up").symlink_to(tmp_path)
    monkeypatch.chdir(tmp_path)
    return folder


ELSEWHERE = (
    "../secret.csv", "{outside}/secret.csv", "/etc/passwd", "link.csv", "loop.csv", "up/secret.csv",
    "up/../secret.csv", "~/secret.csv/../../../secret.csv", "file:///etc/passwd", "C:secret.csv", "a\0b",
)  # fmt: skip


@pytest.mark.parametrize("named", ELSEWHERE)
def test_a_file_names_nothing_outside_of_its_folder(place, named):
    with pytest.raises(ValueError, match=r"is not in the folder of the file that names it"):
        named_path(named.format(outside=place.parent), place)


@pytest.mark.parametrize("named", ["curve.csv", "sub/curve.csv", "sub/../curve.csv"])
def test_a_file_names_what_lies_in_its_folder_and_users_name_any(place, named):
    assert named_path(named, place) == place / named
    assert named_path("../secret.csv", None).name == "secret.csv"


SENSORS = {
    "efficiency": "efficiency: {{path: {0}}}",
    "lens": "lens: {{transmission_curve: {{path: {0}}}}}",
    "map": "measured: {{dark_counts: {0}}}",
    "map without hash": "measured: {{dark_counts: {{path: {0}, sha256: null}}}}",
    "kernel": "crosstalk: {{mean_fired_neighbors: 0.1, kernel: {{path: {0}}}}}",
}
SCENES = {
    "sensor": "sensors: [{0}]",
    "map of a sensor": "sensors: [{{preset: spadcam, measured: {{dark_counts: {0}}}}}]",
    "recorded path": "trajectory: {{kind: recorded, csv: {0}}}",
    "panorama": "light: {{panorama: {0}}}",
    "scene's panorama": "scene: {{kind: panorama, file: {0}}}",
    "mesh": "scene: {{kind: meshes, files: [{0}]}}",
    "reflectance": "scene: {{kind: meshes, files: [x.obj], materials: {{paint: {0}}}}}",
    "species": "scene: {{kind: forest, species: {0}}}",
    "pictures": "scene: {{kind: pictures, file: {0}}}",
}


@pytest.mark.parametrize("field", SENSORS)
@pytest.mark.parametrize("named", ["../secret.csv", "link.csv"])
def test_a_sensor_s_file_leads_nowhere_and_nothing_is_quoted(place, field, named):
    (place / "device.yaml").write_text(f"preset: spadcam\n{SENSORS[field].format(named)}\n")
    with pytest.raises(ValueError, match="is not in the folder of the file") as refused:
        load_sensor(place / "device.yaml")
    assert "hunter2" not in str(refused.value)


@pytest.mark.parametrize("field", SCENES)
@pytest.mark.parametrize("named", ["../secret.csv", "link.csv"])
def test_a_configuration_leads_nowhere_and_nothing_is_quoted(place, field, named):
    named = named.replace(".csv", ".yaml") if field == "sensor" else named
    (place / "link.yaml").symlink_to(place.parent / "secret.csv")
    (place / "own.yaml").write_text(SCENES[field].format(named))
    with pytest.raises(UserError, match="is not in the folder of the file|link leads") as refused:
        load(str(place / "own.yaml"))
    assert "hunter2" not in str(refused.value)


def test_a_plan_leads_nowhere(place):
    (place / "plan.yaml").write_text("trajectories: [{kind: recorded, csv: ../secret.csv}]\n")
    with pytest.raises(UserError, match="is not in the folder of the file"):
        load_plan(place / "plan.yaml")


def test_content_in_the_folder_is_not_quoted_either(place):
    (place / "curve.csv").write_text(SECRET)
    for text in ("sensors: [{preset: spadcam, efficiency: {path: curve.csv}}]", "trajectory: {kind: recorded, csv: curve.csv}"):  # fmt: skip
        (place / "own.yaml").write_text(text)
        with pytest.raises(UserError) as refused:
            load(str(place / "own.yaml"))
        assert "curve.csv" in str(refused.value)
        assert "hunter2" not in str(refused.value)


def test_the_command_line_names_any_file(place):
    (place.parent / "curve.csv").write_text("400,0.1\n1000,0.2\n")
    (place / "own.yaml").write_text("sensors: [spadcam]\n")
    given = {"sensors.0.efficiency": "{path: curve.csv}"}
    assert load(str(place / "own.yaml"), given).sensors[0].efficiency.values == (0.1, 0.2)
    assert isinstance(parse("name: x", "text"), Configuration)
