"""What is told of a sequence from two probes, and that nothing is left of a probe."""

import numpy as np
import pytest
from filelock import FileLock

from megalopta.config.model import load
from megalopta.stages.probing import Probe, Scale, foresee, probe, probe_folder


def probe_of(things, pixels, *, setup, radiance, rest, frame_bytes):
    """A probe of one sample a pixel, of 10 triangles a thing and 100 more."""
    return Probe(
        scale=Scale(things, 100.0 + 10 * things, pixels, float(pixels), 2, 3, 0, 1.0),
        growing=np.full(2, 12.0),
        setup=np.full(2, setup),
        compiling=np.full(2, 5.0),
        once=np.zeros(2),
        radiance=np.full(2, radiance),
        rest=np.full(2, rest),
        fixed_bytes=1000.0,
        frame_bytes=frame_bytes,
    )


SMALL = probe_of(20, 100, setup=3.0, radiance=0.2, rest=0.1, frame_bytes=2000.0)
LARGE = probe_of(60, 1100, setup=7.0, radiance=1.2, rest=0.1, frame_bytes=12000.0)


def test_a_sequence_between_and_beyond_two_probes_lies_on_the_line_through_them():
    told = foresee(Scale(1000, 10_100.0, 2100, 2100.0, 10, 11, 550, 1.0), [SMALL, LARGE])
    # 0.01 s a triangle of 10,100, a kernel of 5 s, half of 1100 paths, 11 passes of 2.2 s
    np.testing.assert_allclose(told.time, 101 + 5 + 0.6 + 11 * 2.2 + 1)
    assert told.bytes == pytest.approx(1000 + 10 * 22_000)
    assert not told.most


def test_where_auto_may_bake_the_time_told_is_the_most():
    settings = load("demo", {"render.integrator": "auto", "trajectory.frames": "100"})
    scale = Scale.of(settings)
    assert scale.most > 1
    few = Scale.of(load("demo", {"render.integrator": "auto", "trajectory.frames": "10"}))
    assert few.most == 1


@pytest.mark.slow
def test_a_probe_renders_a_strip_of_few_frames_and_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    sizes = {"camera.width": "64", "camera.height": "2000", "render.samples_per_pixel": "4"}
    found = probe(load("grating", sizes), 0, lambda _dataset: None)
    assert found.scale.frames == 2
    assert found.scale.pixels < 64 * 300
    assert found.radiance[0] > 0
    assert found.frame_bytes > 64 * 8 * 72
    assert not [
        path for path in tmp_path.rglob("*") if path.name != "probes" and "probes" in path.parts
    ]


def test_what_a_killed_probe_left_goes_with_the_next(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    room = tmp_path / "megalopta/probes"
    for name in ("killed", "living"):
        (room / name).mkdir(parents=True)
        (room / name / "frame.exr").touch()
        (room / f"{name}.lock").touch()
    with FileLock(room / "living.lock"), probe_folder() as own:
        own.mkdir()
        assert {path.name for path in room.iterdir() if path.is_dir()} == {"living", own.name}
    assert {path.name for path in room.iterdir() if path.is_dir()} == {"living"}
