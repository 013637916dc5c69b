"""Scenes and objects of the user's own files, as a user of the stages meets them."""

import json
import shutil

import numpy as np
import pytest
import trimesh

from megalopta.config.model import parse
from megalopta.core.errors import UserError
from megalopta.dataset.reprojection import motions_of
from megalopta.dataset.store import open_sequence
from megalopta.render import read_truth
from megalopta.stages.pipeline import run_stage

from ...scenes.meshes.files import Gltf
from ..small import small

WAY = np.float32([[0, 0, 0], [0, 2, 0]])
SMALL = small(16, 12, 2, sensors="ideal", levels="starlight")
SMALL |= {"trajectory.position_m": "[-4, 0, 1]", "trajectory.look_at_m": "[0, 0, 0]"}


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


def test_a_file_moves_over_any_scene_and_its_change_is_another_configuration(tmp_path):
    trimesh.creation.icosphere(1, 0.5).export(tmp_path / "bird.ply")
    motion = "{velocity_m_s: [0, 1, 0]}"
    text = (
        "scene: {kind: plane}\n"
        f"objects: [{{file: {tmp_path / 'bird.ply'}, motion: {motion}, position_m: [-2, 0, 1]}}]"
    )
    dataset = run_stage(tmp_path / "data", parse(text, "test", SMALL), "render")
    record = json.loads(dataset.scene_record.read_text())
    assert "bird" in record["kinds"] and len(record["motions"]) == 1
    again = open_sequence(tmp_path / "data").configuration
    assert again == dataset.configuration and again.objects[0].name is None
    trimesh.creation.icosphere(1, 0.6).export(tmp_path / "bird.ply")
    with pytest.raises(UserError, match=r"objects\.0\.file\.sha256"):
        run_stage(tmp_path / "data", parse(text, "test", SMALL), "render")


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ("{file: none.glb}", r"objects\.0\.file: none\.glb cannot be read"),
        (
            "{shape: box, sise_m: [1, 1, 1]}",
            r"objects\.0\.sise_m: unknown key; did you mean 'size_m'",
        ),
        ("{shape: cone}", r"objects\.0\.shape: .*'box' or 'ball', got 'cone'"),
        ("{file: {path: a.glb, sha256: 0}, shape: box}", r"objects\.0\."),
    ],
)
def test_mistakes_of_objects_are_told_by_their_field(given, reason):
    with pytest.raises(UserError, match=reason) as problem:
        parse(f"objects: [{given}]", "test")
    assert "Moving" not in str(problem.value)


def test_an_animated_file_moves_and_its_record_gives_its_motion_again(tmp_path):
    file = Gltf()
    file.triangle(np.float32([[0, -1, 0], [0, 1, -1], [0, 1, 1]]))
    samplers = [{"input": file.accessor(np.float32([0, 1])), "output": file.accessor(WAY)}]
    channels = [{"sampler": 0, "target": {"node": 0, "path": "translation"}}]
    file.header["animations"] = [{"channels": channels, "samplers": samplers}]
    (tmp_path / "a.glb").write_bytes(file.glb())
    scene = f"scene: {{kind: meshes, files: {{file: {tmp_path / 'a.glb'}, animate: true}}}}"
    dataset = run_stage(tmp_path / "data", parse(scene, "test", SMALL), "render")
    (motion,) = motions_of(dataset).values()
    np.testing.assert_allclose(motion.carry(np.zeros((1, 3)), 0.5), [[0, 0, 1]], atol=1e-9)
    # y of the file is up: at a depth of 4 m, objects that rise move upward in the image.
    flow = read_truth(dataset.truth(0)).flow_forward
    middle = flow[6, 8]
    assert middle[1] < -0.1


@pytest.mark.parametrize("name", ["a.stl", "a.glb"])
def test_without_an_animation_nothing_can_move(tmp_path, name):
    trimesh.creation.box().export(tmp_path / name)
    scene = f"scene: {{kind: meshes, files: {{file: {tmp_path / name}, animate: true}}}}"
    with pytest.raises(UserError, match=r"omit (it|animate)"):
        run_stage(tmp_path / "data", parse(scene, "test", SMALL), "render")
