"""Long work is not silent where there is no terminal."""

import re
import sys
import time
from functools import partial

import numpy as np
import pytest

from megalopta.core import progress
from megalopta.core.progress import working


@pytest.fixture
def at(monkeypatch):
    """Sets the time, s."""
    now = [0.0]
    monkeypatch.setattr(progress, "clock", lambda: now[0])
    return partial(now.__setitem__, 0)


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(progress, "INTERVAL_S", 0.05)
    monkeypatch.setattr(progress, "FIRST_S", 0.05)
    monkeypatch.setattr(progress, "STATUS_S", 0.02)


def test_a_single_long_step_is_told_at_intervals(capsys, impatient):
    with progress.progress("Rendering", 3, "frame") as advance:
        time.sleep(0.2)
        advance()
        time.sleep(0.2)
        advance(2)
    lines = capsys.readouterr().err.splitlines()
    assert "Rendering: 0 % of 3 frames · 0:00 so far" in lines
    assert any(line.startswith("Rendering: 33 % of 3 frames · 0:0") for line in lines)
    assert re.fullmatch(r"Rendering: 3 frames in [\d.]+ s", lines[-1])


def test_a_line_is_told_after_two_seconds_and_then_every_ten(at, capsys, monkeypatch):
    monkeypatch.setattr(progress, "STATUS_S", 0.02)
    with working("calibrate"), progress.step("estimating pixels"):
        for now_s in (1.9, 2.0, 11.9, 12.0):
            at(now_s)
            time.sleep(0.1)
    text = "calibrate: at work for {} s; estimating pixels\n"
    assert capsys.readouterr().err == text.format(2) + text.format(12)


def test_a_line_shows_share_and_time_left(at):
    for total, done, seconds, text in (
        (300, 12, 24, "4 % of 300 frames · 9:36 left"),
        (1001, 1, 10, "0 % of 1001 frames · 3 hours left"),
        (60, 0, 130, "0 % of 60 frames · 2:10 so far"),
    ):
        at(0)
        pace = progress.Pace(total, "frame")
        at(seconds)
        pace.count(done)
        assert str(pace) == text


def test_a_long_step_does_not_lengthen_the_time_left(at):
    pace = progress.Pace(10, "figure")
    at(30)
    pace.count(3)
    for since_s, left in ((0, "1:10 left"), (5, "1:05 left"), (50, "1:00 left"), (61, "so far")):
        at(30 + since_s)
        assert str(pace).endswith(left)


def test_time_left_never_grows_whatever_steps_take(at):
    steps_s = np.random.default_rng(1).lognormal(0, 1.5, 400)
    steps_s[200:] *= 20  # slower methods
    pace, left_s = progress.Pace(steps_s.size, "case"), []
    for end_s in np.cumsum(steps_s):
        at(end_s)
        pace.count()
        if told := re.search(r"(\d+):(\d\d) left", str(pace)):
            left_s.append(60 * int(told[1]) + int(told[2]))
    assert left_s == sorted(left_s, reverse=True)
    assert left_s[-1] == 0


def test_steps_kept_from_an_earlier_run_shorten_no_estimate(at):
    pace = progress.Pace(100, "case")
    pace.count(50)
    for done in (1, 2):
        at(300 * done)
        pace.count(5)
    assert str(pace) == "60 % of 100 cases · 40:00 left"


def test_progress_of_silent_work_is_shown_with_its_step(capsys, impatient):
    with progress.progress("Making", 1, "sequence"), progress.silent(), progress.step("baking"):
        with progress.progress("Computing light", 4, "part") as advance:
            advance()
            time.sleep(0.2)
        inner = capsys.readouterr().err
        time.sleep(0.2)
    assert re.search(
        "Making: 0 % of 1 sequence · 0:0. so far; baking, 25 % of 4 parts · 0:0", inner
    )
    outer = capsys.readouterr().err
    assert re.search("Making: 0 % of 1 sequence · 0:0. so far; baking\n", outer)


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
