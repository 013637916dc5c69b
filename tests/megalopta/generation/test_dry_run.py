"""What a dry run measures and multiplies, and that it leaves nothing."""

import numpy as np
import pytest

from megalopta.config.model import load
from megalopta.generation import dry_run as module
from megalopta.generation.dry_run import cost_of, may_bake, measured
from megalopta.stages.pipeline import run_stage


def test_frames_and_pixels_multiply_and_at_most_three_sequences_are_measured(monkeypatch):
    seen = []
    cost = np.array([5.0, 5, 0]), np.array([7.0, 7, 0]), np.array([1e-3, 1e-3, 8])
    monkeypatch.setattr(module, "measured", lambda settings, finish: seen.append(settings) or cost)
    sizes = {"camera.width": "10", "camera.height": "10", "trajectory.frames": "3"}
    *times_s, bytes_ = cost_of([load("grating", sizes)] * 9, lambda _dataset: None)
    assert len(seen) == 3
    # three compilations, nine scenes, nine sequences of 300 pixels
    np.testing.assert_allclose(times_s, 3 * 5 + 9 * 7 + 9 * 0.3)
    assert bytes_ == pytest.approx(9 * 300 * 8)


def test_where_auto_may_bake_the_time_told_is_the_most():
    settings = load("demo", {"render.integrator": "auto", "trajectory.frames": "100"})
    assert may_bake(settings)
    few = load("demo", {"render.integrator": "auto", "trajectory.frames": "4"})
    assert not may_bake(few)


@pytest.mark.slow
def test_the_stated_size_is_that_of_the_files_within_a_factor_of_two(tmp_path, monkeypatch):
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    sizes = {"camera.width": "128", "camera.height": "128", "render.samples_per_pixel": "4"}
    settings = load("grating", {**sizes, "trajectory.frames": "4"})
    bytes_ = cost_of([settings], lambda _dataset: None)[2]
    assert not list(temporary.iterdir())
    dataset = run_stage(tmp_path / "data", settings, "render")
    made = sum(path.stat().st_size for path in dataset.root.rglob("*") if path.is_file())
    assert made / 2 < bytes_ < 2 * made


@pytest.mark.slow
def test_light_that_is_on_disk_already_is_baked_again(tmp_path, monkeypatch):
    """The next dry run would find its light there, and foresee no time for it."""
    monkeypatch.setattr("megalopta.stages.render.cache_folder", lambda: tmp_path)
    few = {"scene.trees": "5", "scene.undergrowth": "0", "render.integrator": "baked"}
    sizes = {"camera.width": "16", "camera.height": "16", "render.samples_per_pixel": "1"}
    _, scene, _ = measured(load("demo", few | sizes), lambda _dataset: None)
    assert scene[0] > 0
    assert not list(tmp_path.iterdir())
