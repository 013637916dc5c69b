"""`megalopta check`: what it hands on, and its exit code."""

import pytest

from megalopta import checks
from megalopta.cli import main as cli


def test_a_failed_check_is_exit_code_1(monkeypatch):
    monkeypatch.setattr(checks, "run_check_physics", lambda plots: False)
    with pytest.raises(SystemExit) as stopped:
        cli.main(["check", "physics"])
    assert stopped.value.code == 1


def test_a_passed_check_hands_the_folder_for_plots_on(monkeypatch, tmp_path):
    seen = []
    monkeypatch.setattr(checks, "run_check_physics", lambda plots: seen.append(plots) or True)
    cli.main(["check", "physics", "--plots", str(tmp_path)])
    assert seen == [tmp_path]
