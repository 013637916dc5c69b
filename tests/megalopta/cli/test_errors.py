"""What the command says of a mistake, and of what the machine refuses."""

import errno
import os
import resource
import subprocess
import sys
from itertools import groupby

import pytest

from megalopta.cli import main as cli


@pytest.fixture
def one_line(refused):
    """Runs a command that is refused, and returns the only line that it says."""

    def one_line(*words):
        told = refused(*words)
        assert told.startswith("megalopta: ") and told.count("\n") == 1
        return told

    return one_line


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["flow"], "flow: the following arguments are required: dataset; see megalopta flow"),
        (["reproduce", "fig-4.5", "--workers", "0"], "reproduce: argument --workers: '0'; give a"),
        (["check", "files", "x", "--truth=-1"], "--truth: '-1'; give a whole number, 0"),
        (["render", "--"], "--: not a setting"),
        (["spadcam", "calibrate", "x", "--beam-area-mm2=-0.0"], "'-0.0'; give a finite number"),
        (["benchmark", "photons", "x", "--workers", "1" + "0" * 400], "give a whole number, 1 or"),
        (["benchmark", "photons", "x", "--allow-code"], "--allow-code is for a sweep; omit it"),
        (["benchmark", "photons", "x.yaml", "--redo"], "--redo is for a dataset; omit it"),
        (["rendr", "demo"], "rendr: no such verb; did you mean 'render'?"),
        (["capture"], "capture: no such verb; did you mean 'spadcam capture'?"),
        (["dataset", "mak", "--out", "x"], "dataset mak: no such verb; did you mean 'make'?"),
        (["render", "--scene.trees", "9", "my.yaml"], "my.yaml: no such configuration"),
        (["demo", "--camera.height", "30"], "size 32 × 137 px of frames of 30 × 128 px: choose sizes"),
        (["demo", "airglow", "--quick"], "--quick: airglow has no quick form"),
        (["check", "physics"], "check: argument what: invalid choice: 'physics'"),
        (["reproduce", "fig-2.9"], "no figure 'fig-2.9'; give chapter-4 or some of fig-4.5"),
        *(([*verb.split(), "none"], "none: no such file or folder; check the path") for verb in (
            "sense", "flow", "benchmark photons", "dataset make")),
        *(([*verb.split(), "none"], "none: no dataset here") for verb in ("report", "check truth")),
    ],
)  # fmt: skip
def test_a_mistake_gets_one_sentence_and_makes_nothing(
    one_line, tmp_path, monkeypatch, arguments, message
):
    monkeypatch.chdir(tmp_path)
    assert message in one_line(*arguments)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("words", ["sense dat", "dataset make dat", "report dat", "view dat"])
def test_a_missing_path_gets_the_nearest_name_of_its_folder(one_line, tmp_path, monkeypatch, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").mkdir()
    assert "; did you mean 'data'?" in one_line(*words.split())


@pytest.mark.parametrize(
    ("problem", "message"),
    [
        (OSError(errno.ENOSPC, "No space left on device", "out/x.exr"), "out/x.exr: the disk is full; free some"),
        (OSError(errno.ENOSPC, "No space left on device"), "the disk is full; free some"),
        (PermissionError(errno.EACCES, "Permission denied", "out"), "out: permission denied; change"),
        (FileExistsError(errno.EEXIST, "File exists", "out"), "out: a file is in the way"),
        (MemoryError("Unable to allocate 74.5 GiB"), "out of memory (Unable to allocate 74.5 GiB)"),
        (MemoryError(), "out of memory; ask for less"),
    ],
)  # fmt: skip
def test_what_the_machine_refuses_is_told_with_file_and_remedy(
    one_line, monkeypatch, problem, message
):
    def fails():
        raise problem

    monkeypatch.setattr(cli, "program", fails)
    assert message in one_line("info")


def test_a_fault_of_ours_is_not_told_as_the_users(monkeypatch):
    def fails():
        raise OSError("no error of the system")

    monkeypatch.setattr(cli, "program", fails)
    with pytest.raises(OSError, match="no error of the system"):
        cli.main(["info"])


def run(words, **more):
    command = [sys.executable, "-m", "megalopta", *words]
    return subprocess.run(command, capture_output=True, timeout=60, **more)


def test_too_small_an_address_space_is_refused_before_libraries_wait_for_ever():
    limit = (500_000 * 1024, resource.RLIM_INFINITY)
    done = run(["render"], preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, limit))
    assert done.returncode == 2
    assert b"address space is limited to 0.51 GB" in done.stderr and b"ulimit -v" in done.stderr


@pytest.mark.slow
def test_help_is_printed_where_the_locale_has_ascii_only():
    environment = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii"}
    done = run(["render", "--help-all"], env=environment)
    assert done.returncode == 0 and b"\\xb2" in done.stdout and not done.stderr


def test_a_name_that_is_no_unicode_is_told_in_a_sentence(tmp_path):
    done = run(["render", "--out", os.fsencode(tmp_path / "o") + b"\xff"])
    assert done.returncode == 2 and b"o\\udcff: not UTF-8; rename" in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "text",
    [
        f"scene: {{kind: {'x' * 5000}}}",
        f"{'k' * 5000}: 1",
        f"sensors: [{{preset: {'x' * 5000}}}]",
        f"scene: {{trees: {'x' * 5000}}}",
    ],
)
def test_a_message_quotes_at_most_200_characters_of_a_value(one_line, tmp_path, text):
    (tmp_path / "my.yaml").write_text(text, "utf-8")
    told = one_line("render", tmp_path / "my.yaml")
    assert max(len(list(run)) for _, run in groupby(told)) <= 200 and len(told) < 900
