"""`megalopta reproduce`: what it writes, and names it does not know."""

import pytest

from megalopta.cli import main as cli


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
