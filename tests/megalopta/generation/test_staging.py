"""Publishing broken off at any step, records that somebody changed, other models and variants."""

import gc
import json
import os
import shutil
from contextlib import contextmanager, suppress
from types import SimpleNamespace

import pytest

from megalopta.config.drawing import configuration_of
from megalopta.core.errors import UserError
from megalopta.dataset.layout import Tree
from megalopta.dataset.record import MADE
from megalopta.generation.adding import Exposing, add_exposures
from megalopta.generation.making import make
from megalopta.generation.staging import Staged
from megalopta.stages.registry import made_with
from megalopta.verification.files import check_files

from ..small import content, copied

NEW_LIGHT = Exposing(sensors=("ideal",), light_levels=("full_moon",))
STEPS = ("rename", "replace", "unlink", "rmdir", "mkdir", "symlink", "fsync")
"""Of the file system, at each of which a run is broken off"""


class Stopped(BaseException):
    """As a kill: nothing is cleaned up, as every further step fails, too."""


@contextmanager
def stopped_at(step):
    """Let a number of steps pass; no later one does anything. Yield whether there were fewer."""
    outcome, done = SimpleNamespace(is_over=False), 0

    def counted(call):
        def stepped(*args, **options):
            nonlocal done
            done += 1
            if done > step:
                raise Stopped
            return call(*args, **options)

        return stepped

    with pytest.MonkeyPatch.context() as patch:
        for name in STEPS:
            patch.setattr(os, name, counted(getattr(os, name)))
        with suppress(Stopped):
            yield outcome
            outcome.is_over = True


def staged_again(root, plan):
    """Move a finished sequence back to where it was made."""
    tree = Tree(root)
    record, staged = tree.record("000000"), Staged.of(tree, "000000")
    staged.data.mkdir(parents=True)
    settings = configuration_of(plan, 0)
    staged.begin(made_with(MADE, settings), settings)
    for name in {"/".join(name.split("/000000/")[0].split("/")) for name in record.files}:
        (staged.data / name).mkdir(parents=True)
        (root / name / "000000").rename(staged.data / name / "000000")
    staged.finish(record)
    tree.record_path("000000").unlink()
    (root / "manifest.jsonl").unlink()


def broken_off_everywhere(begun, tmp_path, work, resume, whole):
    """Work on a copy of what was begun, broken off at every step, and then brought to its end."""
    for step in range(1000):
        root = copied(begun, tmp_path / f"step-{step}")
        with stopped_at(step) as outcome:
            work(root)
        gc.collect()  # a lock that was held ends with its process: here, with the last reference
        if outcome.is_over:
            assert step > 20
            return
        resume(root)
        assert content(root) == whole, f"step {step}"
        assert not check_files(Tree(root)), f"step {step}"
        shutil.rmtree(root)


@pytest.mark.slow
def test_a_sequence_is_published_whole_after_a_stop_at_any_step(
    single_copy, single_plan, single_dataset, tmp_path
):
    staged_again(single_copy, single_plan)
    broken_off_everywhere(
        single_copy,
        tmp_path,
        lambda root: make(root, single_plan),
        lambda root: make(root, single_plan),
        content(single_dataset),
    )


@pytest.mark.slow
@pytest.mark.parametrize("resumed", ["expose", "make"])
def test_new_exposures_appear_whole_or_not_at_all(
    single_copy, single_plan, single_dataset, tmp_path, resumed
):
    add_exposures(copied(single_dataset, tmp_path / "whole"), NEW_LIGHT)
    exposed = content(tmp_path / "whole")

    def resume(root):
        if resumed == "make":  # which leaves them out where they were not finished
            make(root, single_plan)
            assert not check_files(Tree(root))
            assert not (root / ".making").exists()
        add_exposures(root, NEW_LIGHT)

    broken_off_everywhere(
        single_copy, tmp_path, lambda root: add_exposures(root, NEW_LIGHT), resume, exposed
    )


@pytest.mark.parametrize("verb", ["make", "expose"])
def test_what_a_kill_after_the_last_move_leaves_is_cleared(single_copy, single_plan, verb):
    left = single_copy / ".making" / "000000" / "data" / "radiance"
    left.mkdir(parents=True)
    (left.parents[1] / ".lock").touch()
    (faults,) = check_files(Tree(single_copy))
    assert "dataset make" in faults.remedy
    if verb == "make":
        make(single_copy, single_plan)
    else:
        add_exposures(single_copy, Exposing(sensors=("spadcam",), light_levels=("twilight",)))
    assert not (single_copy / ".making").exists()
    assert not check_files(Tree(single_copy))


def changed(root, name="000000", **changes):
    path = root / "sequences" / f"{name}.json"
    record = json.loads(path.read_text())
    path.unlink()
    path.write_text(json.dumps({**record, **changes}, indent=1) + "\n")
    return path


@pytest.mark.parametrize("change", ["speed", "split"])
def test_a_changed_record_is_refused_and_not_blessed(single_copy, single_plan, change):
    statistics = json.loads((single_copy / "sequences/000000.json").read_text())["statistics"]
    changes = {"split": "test"}
    if change == "speed":
        changes = {"statistics": {**statistics, "mean_speed_px": 9.0}}
    changed(single_copy, **changes)
    before = (single_copy / "manifest.jsonl").read_bytes()
    for work in (
        lambda: make(single_copy, single_plan),
        lambda: add_exposures(single_copy, NEW_LIGHT),
    ):
        with pytest.raises(UserError, match=r"000000\.json differs from the manifest; restore it"):
            work()
    assert (single_copy / "manifest.jsonl").read_bytes() == before
    assert any(
        "differs from the manifest" in fault.what for fault in check_files(Tree(single_copy))
    )


def test_exposures_that_the_manifest_does_not_know_yet_are_taken(single_copy, single_plan):
    before = (single_copy / "manifest.jsonl").read_bytes()
    add_exposures(single_copy, NEW_LIGHT)
    whole = content(single_copy)
    (single_copy / "manifest.jsonl").write_bytes(before)
    faults = check_files(Tree(single_copy))
    assert ["more output than" in fault.what for fault in faults] == [True]
    make(single_copy, single_plan)
    assert content(single_copy) == whole


def test_exposures_by_another_sensor_model_are_refused(single_copy, monkeypatch):
    before = content(single_copy)
    monkeypatch.setattr("megalopta.stages.sense.SENSOR_MODEL", 99)
    with pytest.raises(
        UserError, match=r"000000 was exposed by another sensor model .*sense: model: \d+ → 99"
    ):
        add_exposures(single_copy, NEW_LIGHT)
    assert content(single_copy) == before


@pytest.mark.parametrize("model", ["render.RENDER_MODEL", "render.TRUTH_MODEL"])
def test_more_sequences_of_another_model_are_refused(single_copy, single_plan, monkeypatch, model):
    monkeypatch.setattr(f"megalopta.stages.{model}", 99)
    make(single_copy, single_plan)  # nothing is missing, and nothing is mixed
    with pytest.raises(UserError, match=r"000000 was made by other software .*render: model: .*99"):
        make(single_copy, single_plan.model_copy(update={"sequences": 2}))
