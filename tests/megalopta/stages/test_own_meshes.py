"""Scenes and objects of the user's own files, as a user of the stages meets them."""

import json
import shutil

import numpy as np
import pytest
import trimesh

from megalopta.cli import main as cli
from megalopta.config.model import parse
from megalopta.core.errors import UserError
from megalopta.dataset.opened import open_dataset
from megalopta.dataset.reprojection import motions_of
from megalopta.dataset.store import open_sequence
from megalopta.render import read_truth
from megalopta.stages.run import run_stage
from megalopta.verification.truth import check_truth

from ...scenes.meshes.files import Gltf
from ...scenes.meshes.test_figures import arm
from ..small import small

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


def test_an_animated_file_moves_and_its_record_gives_its_motion_again(tmp_path):
    file = Gltf()
    file.triangle(np.float32([[0, -1, 0], [0, 1, -1], [0, 1, 1]]))
    file.animate([0, 1], (0, "translation", [[0, 0, 0], [0, 2, 0]]))
    (tmp_path / "a.glb").write_bytes(file.glb())
    scene = f"scene: {{kind: meshes, files: {{file: {tmp_path / 'a.glb'}, animate: true}}}}"
    dataset = run_stage(tmp_path / "data", parse(scene, "test", SMALL), "render")
    (motion,) = motions_of(dataset).values()
    np.testing.assert_allclose(motion.carry(np.zeros((1, 3)), 0.5), [[0, 0, 1]], atol=1e-9)
    # y of the file is up: at a depth of 4 m, objects that rise move upward in the image.
    flow = read_truth(dataset.frame("truth", 0)).flow_forward
    middle = flow[6, 8]
    assert middle[1] < -0.1


def test_flow_of_a_figure_is_rendered_and_between_others_than_neighbors_unknown(tmp_path):
    (tmp_path / "a.glb").write_bytes(arm().glb())
    scene = f"scene: {{kind: meshes, files: {{file: {tmp_path / 'a.glb'}, animate: true}}}}"
    dataset = run_stage(tmp_path / "data", parse(scene, "test", SMALL), "render")
    (motion,) = motions_of(dataset).values()
    assert np.isnan(motion.carry(motion.undo(np.zeros((1, 3)), 0.0), 0.5)).all()
    truth = read_truth(dataset.frame("truth", 0))
    assert np.isfinite(truth.flow_forward[truth.object_id == 1]).all()
    names = [row.name for row in check_truth(dataset)]
    assert names and not any(name.startswith(("moving", "at rest")) for name in names)


@pytest.fixture
def box(tmp_path):
    """Configuration of a box, with a vertex far away that no triangle has, seen along a path."""
    vertices = "v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv 0 0 1\nv 1e5 0 0\n"
    (tmp_path / "box.obj").write_text(vertices + "f 1 2 3 4\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n")
    scene = f"scene: {{kind: meshes, files: {tmp_path / 'box.obj'}}}"
    rendering = small(32, 24, 2, sensors="ideal", levels="starlight")
    return lambda **path: parse(
        scene,
        "test",
        rendering | {f"trajectory.{name}": str(value) for name, value in path.items()},
    )


@pytest.mark.parametrize("integrator", ["auto", "baked"])
def test_a_camera_that_sees_nothing_is_refused_with_bounds_and_a_path_that_sees_all(
    tmp_path, box, integrator
):
    away = box(position_m=[50, 0, 0], look_at_m=[60, 0, 0])
    rendering = away.render.model_copy(update={"integrator": integrator})
    with pytest.raises(
        UserError, match=r"sees no surface.* from \(-1, -1, -1\) to \(1, 1, 1\) m"
    ) as no:
        run_stage(tmp_path / "data", away.model_copy(update={"render": rendering}), "render")
    assert not (tmp_path / "data").exists()
    words = str(no.value).partition("--trajectory.")[2].split("--trajectory.")
    path = {name: values for name, *values in map(str.split, words)}
    given = {name: f"[{', '.join(v)}]" if len(v) > 1 else v[0] for name, v in path.items()}
    truth = read_truth(run_stage(tmp_path / "data", box(**given), "render").frame("truth", 0))
    assert 0.05 < (truth.object_id > 0).mean() < 0.9
    assert not truth.object_id[0].any() and not truth.object_id[:, 0].any()


def test_a_fitted_path_is_the_circle_that_a_refusal_proposes_and_is_kept(tmp_path, box):
    settings = box(kind="fit", frames=3)
    assert settings.trajectory.kind == "orbit"
    assert 2 < settings.trajectory.radius_m < 9 and settings.trajectory.frames == 3
    assert parse(f"scene: {settings.scene.model_dump_json()}\ntrajectory: {{kind: fit, frames: 3}}",
                 "test", {"camera.width": "32", "camera.height": "24"}
                 ).trajectory == settings.trajectory  # fmt: skip
    with pytest.raises(UserError, match="'fit': a scene of kind 'forest' is made for its camera"):
        parse("trajectory: {kind: fit}", "test")


def test_a_view_of_one_frame_is_a_sequence(tmp_path, box, capsys):
    settings = box(kind="fit", frames=1)
    for stage in "render", "sense":
        dataset = run_stage(tmp_path / "data", settings, stage)
    assert not list(dataset.root.glob("training/flow/**/*.flo"))
    (sequence,) = open_dataset(dataset.root)
    assert len(sequence) == 1 and np.isfinite(sequence.depth[0]).any()
    assert sequence.counts("ideal-starlight").shape == (1, 24, 32)
    cli.main(["report", str(dataset.root)])
    cli.main(["view", str(dataset.root), "--out", str(tmp_path / "seen")])
    assert "A single frame has no motion" in (dataset.root / "report.html").read_text()
    with pytest.raises(UserError, match="trajectory.frames 1 leaves fewer than two"):
        run_stage(dataset.root, settings, "flow")
