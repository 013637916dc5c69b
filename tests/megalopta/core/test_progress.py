"""Long work is not silent where there is no terminal."""

import re
import sys
import time

import pytest

from megalopta.core import progress
from megalopta.core.progress import progress_line, working


@pytest.fixture(autouse=True)
def impatient(monkeypatch):
    monkeypatch.setattr(progress, "INTERVAL_S", 0.05)


def test_a_single_long_step_is_told_at_intervals(capsys):
    with progress.progress("Rendering", 3, "frame") as advance:
        time.sleep(0.2)
        advance()
        time.sleep(0.2)
        advance(2)
    lines = capsys.readouterr().err.splitlines()
    assert "Rendering: 0 % of 3 frames · 0:00 so far" in lines
    assert any(line.startswith("Rendering: 33 % of 3 frames · 0:0") for line in lines)
    assert re.fullmatch(r"Rendering: 3 frames in [\d.]+ s", lines[-1])


def test_a_line_shows_share_and_time_left():
    assert progress_line(12, 300, "frame", 24) == "4 % of 300 frames · 9:36 left"
    assert progress_line(1, 1001, "pair", 10) == "0 % of 1001 pairs · 3 hours left"
    assert progress_line(0, 60, "pair", 130) == "0 % of 60 pairs · 2:10 so far"


@pytest.mark.parametrize("since_s", [0, 5, 10, 60, 1e4])
def test_a_long_step_does_not_lengthen_the_time_left(since_s):
    left = progress_line(3, 10, "figure", 30, since_s).partition("· ")[2]
    assert left == {0: "1:10 left", 5: "1:05 left"}.get(since_s, "1:00 left")


def test_progress_of_silent_work_is_shown_with_its_step(capsys):
    with progress.progress("Making", 1, "sequence"), progress.silent(), progress.step("baking"):
        with progress.progress("Computing light", 4, "part") as advance:
            advance()
            time.sleep(0.2)
        inner = capsys.readouterr().err
        time.sleep(0.2)
    assert "Making: 0 % of 1 sequences · 0:00 so far; baking, 25 % of 4 parts · 0:0" in inner
    assert "Making: 0 % of 1 sequences · 0:00 so far; baking\n" in capsys.readouterr().err


def test_a_terminal_shows_the_step_and_clears_it(capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr(progress, "STATUS_S", 0.05)
    with working("render"), progress.step("building the scene"):
        time.sleep(0.2)
        progress.say("done soon")
    told = capsys.readouterr().err
    assert "render: at work for 0 s; building the scene" in told
    assert "done soon\n" in told
    assert told.endswith("\x1b[2K")  # the line is gone
