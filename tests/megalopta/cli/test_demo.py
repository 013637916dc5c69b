"""The short form of the demo."""

import pytest

from megalopta.cli import main


def test_the_quick_form_is_that_of_the_demo_alone(capsys, tmp_path):
    with pytest.raises(SystemExit) as ended:
        main.main(["demo", "airglow", "--quick", "--out", str(tmp_path / "out")])
    assert ended.value.code == 2
    assert "--quick: airglow has none" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
