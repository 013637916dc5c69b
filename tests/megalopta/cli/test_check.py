"""`megalopta check`: what it hands on, and its exit code."""

import pytest

from megalopta.cli import check as cli_check, main as cli
from megalopta.verification import physics
from megalopta.verification.cases import CHECKS


def test_a_failed_check_is_exit_code_1(monkeypatch):
    monkeypatch.setattr(physics, "run_check_physics", lambda groups, plots: False)
    with pytest.raises(SystemExit) as stopped:
        cli.main(["check", "physics"])
    assert stopped.value.code == 1


def test_groups_of_the_physics_are_handed_on_and_named_in_the_help(monkeypatch, capsys):
    seen = []
    monkeypatch.setattr(physics, "run_check_physics", lambda *given: seen.append(given) or True)
    cli.main(["check", "physics", "crosstalk", "dead-time"])
    assert seen == [(["crosstalk", "dead-time"], None)]
    assert tuple(CHECKS) == cli_check.PHYSICS
    with pytest.raises(SystemExit):
        cli.main(["check", "--help"])
    printed = capsys.readouterr().out.replace("-\n", "-")
    assert all(group in printed for group in CHECKS)


def test_a_second_folder_is_refused(capsys):
    with pytest.raises(SystemExit):
        cli.main(["check", "truth", "a", "b"])
    assert "check truth: got a b; give one folder" in capsys.readouterr().err
