"""The stages on a real, tiny dataset: what they write, resume, refuse and repeat."""

import dataclasses
import json
import shutil

import numpy as np
import pytest
import zarr

from megalopta.config.model import load
from megalopta.core.errors import UserError
from megalopta.dataset.opened import open_dataset
from megalopta.dataset.store import Tree, open_sequence
from megalopta.flow.stimuli import photons
from megalopta.flow.stimuli.photons import draw_counts
from megalopta.render import read_truth
from megalopta.report.dataset_card import write_card, write_contact_sheet
from megalopta.stages import registry
from megalopta.stages.registry import STAGES as ORDER
from megalopta.stages.render import FrameWriter
from megalopta.stages.run import finished as finished_stages, has_output, run_all, run_stage
from megalopta.verification.files import check_files, run_check_files

from ..small import content, counting, without


@pytest.fixture(scope="session")
def finished(tiny, tmp_path_factory):
    root = tmp_path_factory.mktemp("finished") / "data"
    return run_all(root, tiny)


@pytest.fixture
def copy(finished, tmp_path):
    shutil.copytree(finished.root, tmp_path / "data")
    return open_sequence(tmp_path / "data")


def test_the_tree_is_sintels_with_one_flow_less_than_frames(finished):
    training = finished.root / "training"
    counts = {kind.name: len(list((kind / "grating").iterdir())) for kind in training.iterdir()}
    assert counts == {
        "clean": 24, "final": 24, "depth": 24, "camdata_left": 24,
        "flow": 23, "occlusions": 23, "invalid": 23,
    }  # fmt: skip


def test_depth_and_camera_files_follow_sintels_layout(finished):
    raw = finished.frame("training/depth", 0).read_bytes()
    assert np.frombuffer(raw[:4], "<f4")[0] == np.float32(202021.25)
    width, height = np.frombuffer(raw[4:12], "<i4")
    depth = np.frombuffer(raw[12:], "<f4").reshape(height, width)
    exact = read_truth(finished.frame("truth", 0)).depth
    np.testing.assert_array_equal(depth, np.where(np.isinf(exact), 1e10, exact).astype("<f4"))
    raw = finished.frame("training/camdata_left", 0).read_bytes()
    intrinsics = np.frombuffer(raw[4:76], "<f8").reshape(3, 3)
    extrinsics = np.frombuffer(raw[76:], "<f8").reshape(3, 4)
    pose = finished.configuration.trajectory.poses()[0]
    # The pixel right at the principal point sees along the optical axis.
    ahead = pose[:3, 3] + 5 * pose[:3, 2]
    x, y, w = intrinsics @ (extrinsics @ np.append(ahead, 1))
    np.testing.assert_allclose([x / w, y / w], [48 / 2 - 0.5, 40 / 2 - 0.5], atol=1e-9)


def test_responses_and_errors_of_every_method_are_there(finished):
    records = json.loads(finished.result("flow.json").read_text())
    settings = finished.configuration
    assert len(records) == 6 * len(settings.sensors) * len(settings.light_levels)
    by_method = {r["method"]: r for r in records if r["sensor"] == "ideal"}
    assert set(by_method) == set(settings.methods)
    assert {name for name, r in by_method.items() if "truth" in r} == {"BM", "IIA"}
    group = zarr.open_group(finished.result("responses") / "ideal-starlight.zarr", mode="r")
    assert set(group) == {f"{m}{end}" for m in settings.methods for end in ("", "-ideal")}


@pytest.mark.parametrize(
    ("stage", "redo", "told"),
    [
        ("render", False, "holds render and sense and flow and benchmark"),
        ("flow", True, "would remove the 'render' output,"),
    ],
)
def test_another_configuration_is_refused_with_the_difference(copy, stage, redo, told):
    before = content(copy.root)
    changed = copy.configuration.model_copy(update={"seed": 7})
    with pytest.raises(UserError, match=f"{told} .*seed: 0 → 7"):
        run_stage(copy.root, changed, stage, redo=redo)
    assert content(copy.root) == before


def test_redo_replaces_what_disagrees_and_keeps_the_rest(whole_copy):
    copy = open_sequence(whole_copy)
    rendering = content(copy.root / "radiance")
    changed = copy.configuration.model_copy(update={"light_levels": (0.5,)})
    with pytest.raises(UserError, match="light_levels"):
        run_stage(copy.root, changed, "sense")
    dataset = run_stage(copy.root, changed, "sense", redo=True)
    assert content(copy.root / "radiance") == rendering
    assert dataset.counts(changed.sensors[0], 0.5).exists()
    assert not has_output(dataset, "flow")
    assert finished_stages(dataset) == ["render", "sense", "benchmark"]


def test_redo_with_the_same_settings_gives_the_same_bytes(whole_copy):
    before, settings = content(whole_copy), load(str(whole_copy))
    for name in ORDER:
        run_stage(whole_copy, settings, name, redo=True)
    assert content(whole_copy) == before


def test_a_dataset_is_made_again_from_its_own_description(whole, tmp_path):
    again = load(str(whole))
    assert again == open_sequence(whole).configuration
    run_all(tmp_path / "again", again)
    assert content(tmp_path / "again") == content(whole)


@pytest.mark.parametrize(
    "command",
    [
        ("render", "{root}", "--out", "{root}", "--scene.cycles-per-frame", "4.25"),  # not closed
        ("sense", "{root}", "--light-levels", "1e300"),
        ("sense", "{root}", "--sensors", "[missing.yaml]"),
        ("flow", "{root}", "--methods", "XX"),
    ],
)
def test_a_refused_redo_leaves_everything_as_it_was(copy, command, refused):
    before = content(copy.root)
    told = refused(*(word.format(root=copy.root) for word in command), "--redo")
    assert len(told.strip().splitlines()) in (1, 2)  # "building", and why not
    assert content(copy.root) == before


def test_light_that_is_too_bright_for_events_leaves_no_trace(tiny, tmp_path):
    dataset = run_stage(tmp_path / "data", tiny, "render")
    before = content(dataset.root)
    bright = {"products": ("counts", "events_hdf5"), "light_levels": (1e6,)}
    with pytest.raises(UserError, match="events in a frame"):
        run_stage(dataset.root, tiny.model_copy(update=bright), "sense")
    assert content(dataset.root) == before
    assert not has_output(dataset, "sense")


def test_a_rendered_dataset_is_read_and_shown_before_it_is_sensed(tiny, tmp_path):
    run_stage(tmp_path / "data", tiny, "render")
    sequence = open_dataset(tmp_path / "data")[0]
    assert sequence.exposures == ()
    with pytest.raises(UserError, match="no counts yet; run: megalopta sense"):
        sequence.counts()
    with pytest.raises(UserError, match="a dataset without a plan"):
        write_card(tmp_path / "data")
    for name in ("imu", "tracks", "albedo", "leaf_clusters"):
        with pytest.raises(UserError, match=r"no .*; (render|sense) with `"):
            getattr(sequence, name)
    page = write_contact_sheet(tmp_path / "data", 1).read_text("utf-8")
    assert page.count("data:image/gif") == 3  # light, flow and depth


def test_bench_goes_on_after_an_interruption(copy, monkeypatch):
    before = content(copy.root)
    without(copy.root, "benchmark")
    repeats = copy.configuration.benchmark.repeats
    monkeypatch.setattr(photons, "draw_counts", counting(draw_counts, drawn := []))
    run_stage(copy.root, copy.configuration, "benchmark")
    a_repeat = len(drawn) // repeats
    without(copy.root, "benchmark")
    monkeypatch.setattr(photons, "draw_counts", counting(draw_counts, [], a_repeat + 1))
    with pytest.raises(KeyboardInterrupt):
        run_stage(copy.root, copy.configuration, "benchmark")
    monkeypatch.setattr(photons, "draw_counts", counting(draw_counts, drawn := []))
    run_stage(copy.root, copy.configuration, "benchmark")
    assert len(drawn) == a_repeat * (repeats - 1)
    assert content(copy.root) == before


def test_damage_is_named_with_its_remedy(copy, capsys):
    assert check_files(Tree(copy.root)) == []
    missing = copy.frame("radiance", 3)
    (copy.root / "litter.txt").write_text("?")
    path = copy.counts(copy.configuration.sensors[0], "twilight") / "counts/c/0/0/0"
    path.write_bytes(bytes(path.stat().st_size))
    missing.unlink()
    assert not run_check_files(copy.root)
    text = capsys.readouterr().out
    assert f"{missing}: is missing; run: megalopta render {copy.root} --out" in text
    assert f"{path}: differs from its record; remove {path.parents[4]} and run" in text
    assert "litter.txt: belongs to no sequence" in text
    assert "3 faults" in text


@pytest.fixture
def begun(whole, tmp_path, monkeypatch):
    """A dataset whose rendering stopped in its third frame."""
    write = FrameWriter.write

    def interrupted(self, index):
        if index == 2:
            raise KeyboardInterrupt
        write(self, index)

    root = tmp_path / "begun"
    with monkeypatch.context() as patched, pytest.raises(KeyboardInterrupt):
        patched.setattr(FrameWriter, "write", interrupted)
        run_stage(root, load(str(whole)), "render")
    return root


def test_what_was_begun_goes_on_to_the_same_bytes(begun, whole, monkeypatch):
    assert "run: megalopta render" in check_files(Tree(begun))[0].remedy
    write, written = FrameWriter.write, []
    monkeypatch.setattr(FrameWriter, "write", counting(write, written))
    run_all(begun, load(str(whole)))
    assert [index for _, index in written] == [2, 3]
    assert content(begun) == content(whole)


@pytest.mark.parametrize("what", ["settings", "model", "machinery"])
def test_frames_of_other_settings_or_software_are_not_mixed(begun, monkeypatch, what):
    settings = load(str(begun), {"seed": "7"} if what == "settings" else {})
    if what != "settings":
        made_with = {"model": "9"} if what == "model" else {"drjit": "9"}
        other = dataclasses.replace(registry.STAGES["render"], made_with=lambda _: made_with)
        monkeypatch.setitem(registry.STAGES, "render", other)
    write, written = FrameWriter.write, []
    monkeypatch.setattr(FrameWriter, "write", counting(write, written))
    with pytest.raises(UserError, match="incomplete and of other settings or software .*--redo"):
        run_stage(begun, settings, "render")
    run_stage(begun, settings, "render", redo=True)
    assert [index for _, index in written] == [0, 1, 2, 3]
    assert check_files(Tree(begun)) == []


@pytest.mark.parametrize(("stage", "is_derived"), [("render", False), ("flow", True)])
def test_output_of_another_model_is_refused_unless_it_is_derived(
    whole_copy, monkeypatch, stage, is_derived
):
    other = dataclasses.replace(registry.STAGES[stage], made_with=lambda _: {"model": "another"})
    monkeypatch.setitem(registry.STAGES, stage, other)
    before, settings = content(whole_copy), load(str(whole_copy))
    if is_derived:
        run_stage(whole_copy, settings, stage)
        assert open_sequence(whole_copy).record.stages[stage].made_with == {"model": "another"}
        return
    with pytest.raises(UserError, match="was made with other software .* add --redo"):
        run_stage(whole_copy, settings, stage)
    assert content(whole_copy) == before
    run_stage(whole_copy, settings, "flow")  # what is there is still measured


def test_a_finished_stage_is_kept_whatever_draws_its_noise(whole_copy, capsys):
    before = content(whole_copy)
    run_stage(whole_copy, load(str(whole_copy), {"render.backend": "scalar"}), "render")
    assert "already has it" in capsys.readouterr().err
    changed = {name for name, text in content(whole_copy).items() if text != before[name]}
    assert changed == {"dataset.yaml", "sequences/grating.json"}


def test_a_folder_of_something_else_is_left_alone(tiny, tmp_path):
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(UserError, match="exists and is not a dataset"):
        run_stage(tmp_path, tiny, "render")
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]
