"""What a dry run tells is near to what is made, and a dry run that is killed leaves nothing."""

import os
import subprocess
import sys
import time

import pytest

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
def test_a_dry_run_that_is_killed_leaves_nothing_after_the_next(tmp_path):
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    command = [sys.executable, "-m", "megalopta", "render", "grating", "--dry-run"]
    command += ["--out", str(tmp_path / "out"), "--camera.width", "16", "--camera.height", "16"]
    room = tmp_path / "megalopta/probes"
    process = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)
    while not list(room.glob("*/radiance")):
        assert process.poll() is None
        time.sleep(0.01)
    process.kill()
    process.wait()
    assert list(room.iterdir())
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    assert "40 frames of 16 × 16, about" in done.stdout
    assert "integrator: path" in done.stdout
    assert not list(room.iterdir())
    assert not (tmp_path / "out").exists()
