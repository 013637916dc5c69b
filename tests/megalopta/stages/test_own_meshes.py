"""Scenes and objects of the user's own files, as a user of the stages meets them."""

import shutil

import numpy as np
import pytest
import trimesh

from megalopta.config.model import parse
from megalopta.core.errors import UserError
from megalopta.dataset.store import open_sequence
from megalopta.render import read_truth
from megalopta.stages.pipeline import run_stage

SMALL = {
    "trajectory.frames": "2",
    "trajectory.position_m": "[-4, 0, 1]",
    "trajectory.look_at_m": "[0, 0, 0]",
    "camera.width": "16",
    "camera.height": "12",
    "render.samples_per_pixel": "1",
    "sensors": "[ideal]",
    "light_levels": "[starlight]",
}


def settings(folder, size):
    """Configuration of a box of a size on the ground."""
    trimesh.Scene({"hut": trimesh.creation.box((1, 1, size))}).export(folder / "hut.glb")
    scene = f"scene: {{kind: meshes, files: {folder / 'hut.glb'}, ground: soil}}"
    return parse(scene, "test", SMALL)


@pytest.fixture
def rendered(tmp_path):
    (tmp_path / "files").mkdir()
    return run_stage(tmp_path / "data", settings(tmp_path / "files", 1.0), "render")


def test_nodes_are_kinds_of_the_truth(rendered):
    truth = read_truth(rendered.truth(0))
    assert set(np.unique(truth.object_id)) == {0, 1, 2}


def test_a_changed_file_is_another_scene(rendered, tmp_path):
    changed = settings(tmp_path / "files", 2.0)
    with pytest.raises(UserError, match=r"another configuration \(scene\.files\.0\.file\.sha256: "):
        run_stage(tmp_path / "data", changed, "render")
    with pytest.raises(UserError, match=r"hut\.glb has changed since it was first used"):
        run_stage(tmp_path / "other", rendered.configuration, "render")


def test_a_dataset_elsewhere_is_sensed_and_says_what_rendering_needs(rendered, tmp_path):
    shutil.copytree(tmp_path / "data", tmp_path / "copy")
    shutil.rmtree(tmp_path / "files")
    copy = open_sequence(tmp_path / "copy")
    run_stage(tmp_path / "copy", copy.configuration, "sense")
    with pytest.raises(UserError, match=r"hut\.glb cannot be read \(no such file or directory\)"):
        run_stage(tmp_path / "new", copy.configuration, "render")
