"""Stages that were broken off or are made again: the same renderer and libraries, nothing fresh lost."""

import contextlib
import dataclasses
import json
import shutil
from pathlib import Path

import pytest

from megalopta.cli import main as cli
from megalopta.core.errors import UserError
from megalopta.dataset.store import open_sequence
from megalopta.stages import redo, registry
from megalopta.stages.ledger import Ledger
from megalopta.stages.pipeline import run_stage
from megalopta.stages.redo import open_dataset_whole
from megalopta.stages.registry import STAGES, provenance, provenance_changes
from megalopta.stages.render import FrameWriter

from ..small import content, counting


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
        run_stage(root, open_sequence(whole).configuration, "render")
    return open_sequence(root)


def with_backend(configuration, backend):
    rendering = configuration.render.model_copy(update={"backend": backend})
    return configuration.model_copy(update={"render": rendering})


def test_frames_of_two_variants_are_not_mixed(begun):
    before = content(begun.root)
    scalar = with_backend(begun.configuration, "scalar")
    if "llvm" not in STAGES["render"].machinery(begun.configuration):
        pytest.skip("no LLVM here")
    with pytest.raises(
        UserError, match=r"'render' output is incomplete .*variant: llvm_ad_\w+ → scalar_.*--redo"
    ):
        run_stage(begun.root, scalar, "render")
    assert content(begun.root) == before
    run_stage(begun.root, scalar, "render", redo=True)
    assert json.loads(begun.scene_record.read_text("utf-8"))["variant"] == "scalar_spectral"


def test_with_the_same_it_goes_on_to_the_same_bytes(begun, whole):
    run_stage(begun.root, begun.configuration, "render")
    expected = content(whole / "radiance") | content(whole / "truth")
    found = content(begun.root / "radiance") | content(begun.root / "truth")
    assert found == expected
    assert Ledger(begun).entry("render") == Ledger(open_sequence(whole)).entry("render")


def test_a_finished_stage_is_kept_whatever_made_it(whole_copy, capsys):
    before = content(whole_copy)
    scalar = with_backend(open_sequence(whole_copy).configuration, "scalar")
    run_stage(whole_copy, scalar, "render")
    assert "already has it" in capsys.readouterr().err
    assert content(whole_copy).keys() == before.keys()
    assert all(content(whole_copy)[n] == before[n] for n in before if n != "dataset.yaml")


@pytest.mark.parametrize("what", ["model", "machinery"])
def test_counts_of_two_sensor_models_or_libraries_are_not_mixed(whole_copy, monkeypatch, what):
    dataset = open_sequence(whole_copy)
    Ledger(dataset).forget("sense")
    Ledger(dataset).begin("sense")
    (whole_copy / "counts/grating/spadcam-starlight.zarr").mkdir(parents=True)  # one of several
    changed = {"model": lambda: "9"} if what == "model" else {"machinery": lambda _: {"numpy": "9"}}
    other = dataclasses.replace(registry.STAGES["sense"], **changed)
    monkeypatch.setitem(registry.STAGES, "sense", other)
    before = dataset.record_path.read_text("utf-8")
    with pytest.raises(
        UserError, match=r"'sense' output is incomplete .*(model: 8 → 9|numpy: .* → 9)"
    ):
        run_stage(whole_copy, dataset.configuration, "sense")
    assert dataset.record_path.read_text("utf-8") == before


@pytest.mark.parametrize(
    ("stage", "part"),
    [("flow", "responses/spadcam-starlight.zarr"), ("benchmark", "benchmark-parts/light.zarr")],
)
def test_results_begun_by_other_code_are_begun_again(whole_copy, monkeypatch, stage, part):
    before, dataset = content(whole_copy), open_sequence(whole_copy)
    other = dataclasses.replace(registry.STAGES[stage], model=lambda: "of other code")
    Ledger(dataset).forget(stage)
    with monkeypatch.context() as patched:
        patched.setitem(registry.STAGES, stage, other)
        Ledger(dataset).begin(stage)
    dataset.result(part).mkdir(parents=True)
    run_stage(whole_copy, dataset.configuration, stage)
    assert content(whole_copy) == before


def run(*words):
    cli.main([str(word) for word in words])


def test_what_depends_on_new_output_survives_the_next_redo(whole_copy):
    run("sense", whole_copy, "--redo", "--light-levels", "[twilight]", "--sensors", "[ideal]")
    assert not (whole_copy / "results/grating/flow.json").exists()
    run("flow", whole_copy, "--redo", "--methods", "[LK]")
    dataset = open_sequence(whole_copy)
    assert Ledger(dataset).is_finished("flow")
    (record,) = json.loads(dataset.result("flow.json").read_text("utf-8"))
    assert (record["method"], record["sensor"], record["level"]) == ("LK", "ideal", "twilight")
    assert not Ledger(dataset).has("benchmark")  # its methods were others
    assert not (whole_copy / ".redo").exists()


@pytest.fixture
def broken(whole_copy, monkeypatch):
    """A dataset whose new counts were about to move when the program stopped."""
    configuration = open_sequence(whole_copy).configuration
    changed = configuration.model_copy(update={"light_levels": (0.5,)})

    def killed(root):
        raise KeyboardInterrupt

    monkeypatch.setattr(redo, "complete_redo", killed)
    with pytest.raises(KeyboardInterrupt):
        run_stage(whole_copy, changed, "sense", redo=True)
    monkeypatch.undo()
    assert (whole_copy / ".redo/publish.json").exists()
    return whole_copy


@pytest.mark.parametrize("verb", ["check files", "check truth", "report", "benchmark sequence"])
def test_who_only_reads_does_not_finish_a_move(broken, verb, refused):
    before = content(broken)
    told = refused(*verb.split(), broken)
    assert f"to finish, run: megalopta render {broken} --out {broken}" in told
    assert content(broken) == before


def test_the_command_that_is_told_finishes_a_move(broken):
    run("render", broken, "--out", broken)
    dataset = open_sequence(broken)
    assert dataset.configuration.light_levels == (0.5,)
    assert Ledger(dataset).finished() == ["render", "sense", "benchmark"]
    assert not (broken / ".redo").exists()


def test_a_move_that_stops_anywhere_is_finished_to_the_same_bytes(broken, tmp_path, monkeypatch):
    once = shutil.copytree(broken, tmp_path / "once", symlinks=True)
    open_dataset_whole(once)
    steps = 0
    while (broken / ".redo").exists():
        steps += 1
        with monkeypatch.context() as patched:
            patched.setattr(Path, "rename", counting(Path.rename, [], steps))
            with contextlib.suppress(KeyboardInterrupt):
                open_dataset_whole(broken)
    assert steps > 3
    assert content(broken) == content(once)


def test_what_was_not_recorded_is_not_compared(tiny):
    for stage in STAGES:
        assert provenance_changes({}, provenance(stage, tiny)) == ""
        assert provenance_changes({"model": "old"}, provenance(stage, tiny)).startswith(
            "model: old"
        )
