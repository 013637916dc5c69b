"""What is told of a sequence from a probe, and that nothing is left of a probe."""

import numpy as np
import pytest

from megalopta.config.model import load
from megalopta.generation.dry_run import Probe, Scale, foresee, may_bake, probe

SMALL = Probe(
    scale=Scale(60, 700.0, 1100, 1100.0, 2, 3, 0),
    setup=np.array([7.0, 7.0, 0.0]),
    compiling=np.array([5.0, 5.0, 0.0]),
    once=np.array([2.0, 2.0, 0.0]),
    radiance=np.array([1.2, 1.2, 0.0]),
    rest=np.array([0.1, 0.1, 12000.0]),
)
"""A probe of one sample a pixel, of 10 triangles a thing and 100 more."""
LARGE = Scale(1000, 10_500.0, 2200, 2200.0, 10, 11, 550)


def test_a_sequence_takes_in_proportion_to_a_probe():
    *times_s, bytes_ = foresee(LARGE, SMALL)
    # 15 times the triangles, twice the pixels, half of 1100 paths, 11 passes, a kernel
    np.testing.assert_allclose(times_s, 15 * 7 + 2 * 2 + 0.6 + 11 * 2.4 + 10 * 0.2 + 5)
    assert bytes_ == pytest.approx(10 * 24_000)


def test_only_the_first_compiles():
    first, later = (foresee(LARGE, SMALL, is_first) for is_first in (True, False))
    np.testing.assert_allclose(first - later, [5, 5, 0])


def test_where_auto_may_bake_the_time_told_is_the_most():
    settings = load("demo", {"render.integrator": "auto", "trajectory.frames": "100"})
    assert may_bake(settings)
    few = load("demo", {"render.integrator": "auto", "trajectory.frames": "4"})
    assert not may_bake(few)


def test_a_probe_renders_a_strip_of_few_frames_and_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    sizes = {"camera.width": "64", "camera.height": "2000", "render.samples_per_pixel": "4"}
    found = probe(load("grating", sizes), 0, lambda _dataset: None, True)
    assert found.scale.frames == 2
    assert found.scale.pixels < 64 * 300
    assert found.radiance[0] > 0
    assert found.rest[2] > 64 * 8 * 72
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_probe_bakes_light_that_is_on_disk_already(tmp_path, monkeypatch):
    """The next probe would find its light there, and foresee no time for it."""
    monkeypatch.setattr("megalopta.stages.render.cache_folder", lambda: tmp_path)
    few = {"scene.trees": "5", "scene.undergrowth": "0", "render.integrator": "baked"}
    sizes = {"camera.width": "16", "camera.height": "16", "render.samples_per_pixel": "1"}
    found = probe(load("demo", few | sizes), 5, lambda _dataset: None, True)
    assert found.once[0] > 0
    assert not list(tmp_path.iterdir())
