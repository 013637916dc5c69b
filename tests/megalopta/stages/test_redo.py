"""Output made again: nothing fresh is lost, and a broken move is finished by those who work."""

import contextlib
import json
import shutil
from pathlib import Path

import pytest

from megalopta.cli import main as cli
from megalopta.dataset.store import open_sequence
from megalopta.stages import redo
from megalopta.stages.ledger import Ledger
from megalopta.stages.pipeline import run_stage
from megalopta.stages.redo import open_dataset_whole

from .test_pipeline import content


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
def test_who_only_reads_does_not_finish_a_move(broken, verb, capsys):
    before = content(broken)
    with pytest.raises(SystemExit):
        run(*verb.split(), broken)
    told = capsys.readouterr().err
    assert f"to finish that, run: megalopta render {broken} --out {broken}" in told
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
            patched.setattr(Path, "rename", _stopping(Path.rename, steps))
            with contextlib.suppress(KeyboardInterrupt):
                open_dataset_whole(broken)
    assert steps > 3
    assert content(broken) == content(once)


def _stopping(function, calls):
    """The function, which ends with Ctrl-C instead of being called so many times."""
    left = iter(range(calls - 1))

    def called(*arguments):
        if next(left, None) is None:
            raise KeyboardInterrupt
        return function(*arguments)

    return called
