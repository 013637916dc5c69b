"""A file is the same input by any path and name: its content counts."""

import cv2
import numpy as np
import pytest
import trimesh

from megalopta.config.model import differences, load
from megalopta.stages.registry import STAGES, stage_configuration

WALK = "t,x,y,z,qx,qy,qz,qw\n0,0,0,1,0,0,0,1\n9,1,0,1,0,0,0,1\n"
DEVICE = "preset: ideal\nname: mine\nmeasured: {dark_counts: map.npy}\n"


def picture(path, value):
    cv2.imwrite(str(path), np.full((16, 32, 3), value, np.uint8))


def device(path, value):
    np.save(path.parent / "map.npy", np.full((4, 4), float(value)))
    path.write_text(DEVICE)


KINDS = {
    "pictures": ("a.png", picture, "scene: {{kind: pictures, file: {}}}"),
    "films": ("film", lambda p, v: (p.mkdir(exist_ok=True), picture(p / "1.png", v)),
              "scene: {{kind: pictures, file: {}}}"),
    "meshes": ("a.stl", lambda p, v: trimesh.creation.box((1, 1, v)).export(p),
               "scene: {{kind: meshes, files: [{}]}}"),
    "objects": ("a.stl", lambda p, v: trimesh.creation.box((1, 1, v)).export(p),
                "{{scene: {{kind: grating}}, objects: [{{file: {}}}]}}"),
    "panoramas": ("a.png", picture, "light: {{panorama: {}}}"),
    "trajectories": ("a.csv", lambda p, v: p.write_text(WALK.replace("9,1", f"9,{v}")),
                     "trajectory: {{kind: recorded, frames: 3, csv: {}}}"),
    "sensors": ("a.yaml", device, "sensors: [{}]"),
    "curves": ("a.csv", lambda p, v: p.write_text(f"wavelength_nm,efficiency\n300,0.{v}\n1100,0.1\n"),
               "sensors: [{{preset: ideal, efficiency: {{path: {}}}}}]"),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_a_copy_of_a_file_is_the_same_input_and_other_content_is_not(kind, tmp_path):
    name, write, text = KINDS[kind]
    settings = {}
    for folder, value in (("here", 40), ("there", 40), ("other", 41)):
        (tmp_path / folder).mkdir()
        file = tmp_path / folder / (name if kind == "films" else f"{folder}-{name}")
        write(file, value)
        path = tmp_path / f"{folder}.yaml"
        path.write_text(text.format(file.relative_to(tmp_path)))
        settings[folder] = load(str(path))
    here, there, other = settings.values()
    for stage in STAGES:
        assert stage_configuration(here, stage) == stage_configuration(there, stage)
    assert not differences(here.model_dump(mode="json"), there.model_dump(mode="json"))
    assert differences(here.model_dump(mode="json"), other.model_dump(mode="json"))
