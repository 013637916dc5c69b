"""The verbs that need no dataset: check and reproduce."""

import pytest

from megalopta.checks import physics as check_physics
from megalopta.cli import main as cli


def test_a_failed_check_is_exit_code_1(monkeypatch):
    monkeypatch.setattr(check_physics, "run_check_physics", lambda plots: False)
    with pytest.raises(SystemExit) as stopped:
        cli.main(["check", "physics"])
    assert stopped.value.code == 1


def test_a_passed_check_hands_the_folder_for_plots_on(monkeypatch, tmp_path):
    seen = []
    monkeypatch.setattr(
        check_physics, "run_check_physics", lambda plots: seen.append(plots) or True
    )
    cli.main(["check", "physics", "--plots", str(tmp_path)])
    assert seen == [tmp_path]


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
