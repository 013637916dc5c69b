"""What a dry run tells is near to what is made."""

import pytest

from megalopta.cli.main import main
from megalopta.config.drawing import configuration_of
from megalopta.dataset.store import files_in
from megalopta.generation.dry_run import costs_of


@pytest.mark.slow
def test_the_size_told_is_within_30_percent_of_what_is_made(small_plan, small_dataset):
    drawn = [configuration_of(small_plan, index) for index in range(small_plan.sequences)]
    told = sum(each.bytes for each in costs_of(small_plan, drawn))
    books = ("index", "splits", "sequences")
    made = sum(
        path.stat().st_size
        for path in files_in([small_dataset])
        if path.relative_to(small_dataset).parts[0] not in books
    )
    assert told == pytest.approx(made, rel=0.3)


@pytest.mark.slow
def test_a_dry_run_of_one_sequence_tells_and_makes_nothing(tmp_path, capsys):
    words = ["render", "grating", "--dry-run", "--out", str(tmp_path / "out")]
    main([*words, "--camera.width", "16", "--camera.height", "16"])
    told = capsys.readouterr().out
    assert "40 frames of 16 × 16, about" in told
    assert "integrator: path" in told
    assert not (tmp_path / "out").exists()
