"""What an estimate measures and multiplies, and that it leaves nothing."""

import pytest
import yaml

from megalopta.cli import main
from megalopta.config.drawing import configuration_of
from megalopta.config.recipe import Plan
from megalopta.stages import estimate
from megalopta.stages.make import make


@pytest.mark.slow
def test_the_stated_size_is_that_of_the_files_within_a_factor_of_two(tmp_path, monkeypatch):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    sizes = {"camera": {"width": 128, "height": 128}, "render": {"samples_per_pixel": 4}}
    every = {**sizes, "trajectory": {"frames": 4}}
    plan = Plan(sequences=1, scenes=("grating",), every=every, sensors=("ideal",))
    _, bytes_ = estimate.cost_of([configuration_of(plan, 0)], plan)
    assert not list(temporary.iterdir())
    make(tmp_path / "data", plan)
    files = [path for path in (tmp_path / "data").rglob("*") if path.is_file()]
    made = sum(path.stat().st_size for path in files if not path.is_symlink())
    assert made / 2 < bytes_ < 2 * made


@pytest.mark.slow
def test_a_dry_run_tells_and_makes_nothing(small_plan, tmp_path, capsys):
    plan, out = tmp_path / "plan.yaml", tmp_path / "data"
    plan.write_text(yaml.safe_dump(small_plan.model_dump(mode="json")))
    words = ["dataset", "make", str(plan), "--out", str(out), "--dry-run", "--sequences", "50"]
    main.main(words)
    told = capsys.readouterr().out
    assert "50 sequences, 150 frames, about" in told
    assert "MB" in told
    assert not out.exists()
