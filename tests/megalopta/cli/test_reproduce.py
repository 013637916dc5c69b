"""`megalopta reproduce`: what it writes, and names it does not know."""

import subprocess
import sys
import time

import numpy as np
import psutil
import pytest

from megalopta.cli import main as cli

KILLS = 6
FIGURES = "fig-2.9", "fig-2.14", "fig-3.2"


def test_reproduce_writes_picture_print_and_numbers(tmp_path, capsys):
    cli.main(["reproduce", "fig-3.2", "--out", str(tmp_path)])
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "fig-3.2.csv",
        "fig-3.2.json",
        "fig-3.2.png",
        "fig-3.2.svg",
    ]
    assert len(capsys.readouterr().out.splitlines()) == 4


def test_an_unknown_figure_is_a_mistake_with_close_names(tmp_path, capsys):
    with pytest.raises(SystemExit) as stopped:
        cli.main(["reproduce", "fig-3.99", "--out", str(tmp_path / "new")])
    assert stopped.value.code == 2
    assert "did you mean" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


@pytest.mark.slow
def test_killed_at_random_moments_it_writes_the_same_when_run_again(tmp_path):
    def reproduce(folder, after_s=None):
        command = [sys.executable, "-m", "megalopta", "reproduce", *FIGURES, "--out", folder]
        quiet = subprocess.DEVNULL
        process = subprocess.Popen(command, stdout=quiet, stderr=quiet, start_new_session=True)
        if after_s is None:
            assert process.wait() == 0
            return
        time.sleep(after_s)
        children = psutil.Process(process.pid).children(recursive=True)
        process.kill()
        process.wait()
        assert not psutil.wait_procs(children, timeout=5)[1]

    def content(folder):
        return {path.name: path.read_bytes() for path in folder.iterdir()}

    began = time.monotonic()
    reproduce(tmp_path / "whole")
    lasts_s = time.monotonic() - began
    for number, moment in enumerate(np.random.default_rng(0).uniform(0, lasts_s, KILLS)):
        folder = tmp_path / str(number)
        reproduce(folder, moment)
        reproduce(folder)
        assert content(folder) == content(tmp_path / "whole")
