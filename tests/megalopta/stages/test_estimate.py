"""What is absurd is refused before anything is built; what is much is announced and probed."""

import shutil

import numpy as np
import pytest
from filelock import FileLock

from megalopta.benchmark.sweep import Sweep
from megalopta.config.model import load
from megalopta.core.errors import UserError
from megalopta.stages import estimate
from megalopta.stages.estimate import refuse_absurd
from megalopta.stages.pipeline import run_all, run_stage
from megalopta.stages.probing import Probe, Scale, foresee, probe, probe_folder


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("trajectory.frames", "1000000000"),
        ("camera.width", "100000"),
        ("camera.fov_deg", "1e-300"),
        ("shutter.poses", "1000000000"),
        ("benchmark.fluxes_per_decade", "100000000"),
        ("benchmark.repeats", "1000000000"),
        ("render.samples_per_pixel", "1000000000"),
        ("light.illuminance_lux", "1e308"),
        ("light.illuminance_lux", "1e-300"),
        ("light_levels", "[1e300]"),
        ("scene.trees", "1" + "0" * 400),
    ],
)
def test_a_value_beyond_sense_is_refused_by_its_field(path, value):
    with pytest.raises(UserError, match=path):
        load("demo", {path: value})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"trajectory.frames": "1000000"}, r"1000000 frames of 80 × 80 would take about .* days of work"),
        ({"camera.width": "32768", "camera.height": "32768"}, r"about 1.1[0-9] TB of memory, and this machine has .*; lower"),
    ],
)  # fmt: skip
def test_a_rendering_beyond_the_machine_is_refused_before_it_is_begun(tmp_path, changes, message):
    with pytest.raises(UserError, match=message):
        run_stage(tmp_path / "out", load("demo", changes), "render")
    assert not list(tmp_path.iterdir())


def test_every_stage_is_weighed_before_the_first_begins(tmp_path):
    settings = load("demo", {"benchmark.repeats": "100000", "benchmark.fluxes_per_decade": "400"})
    with pytest.raises(UserError, match=r"benchmark: .* days of work, more than .* 30 days; lower"):
        run_all(tmp_path / "out", settings)
    assert not list(tmp_path.iterdir())


def test_more_than_the_disk_holds_is_refused(tmp_path, monkeypatch):
    full = shutil.disk_usage(tmp_path)._replace(free=1000)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: full)
    with pytest.raises(UserError, match=r"render: .* MB on disk, and .*/out has room for 0 MB"):
        refuse_absurd(load("demo"), "render", tmp_path / "out")


@pytest.mark.parametrize("name", ["demo", "airglow", "grating", "motion-bench"])
@pytest.mark.parametrize("stage", ["render", "sense", "flow", "benchmark"])
def test_the_built_in_configurations_are_no_long_work(tmp_path, capsys, name, stage):
    refuse_absurd(load(name), stage, tmp_path)
    assert estimate.estimate(load(name), stage).seconds < 3600


def test_work_grows_with_the_frames_and_memory_does_not():
    few, many = (load("demo", {"trajectory.frames": frames}) for frames in ("40", "80"))
    for stage in ("render", "sense", "flow", "benchmark"):
        first, second = estimate.estimate(few, stage), estimate.estimate(many, stage)
        assert second.seconds == pytest.approx(2 * first.seconds)
        assert second.disk_bytes == pytest.approx(2 * first.disk_bytes)
        assert second.memory_bytes == pytest.approx(first.memory_bytes, rel=1e-3)


def test_haze_takes_three_times_the_work():
    clear = {"render.integrator": "path", "render.samples_per_pixel": "10000"}
    hazy = {**clear, "scene.haze.visibility_m": "100"}
    first, second = (estimate.estimate(load("demo", each), "render") for each in (clear, hazy))
    assert second.seconds == pytest.approx(3 * first.seconds, rel=1e-2)


def test_a_sweep_of_too_many_trials_is_refused():
    with pytest.raises(ValueError, match="10001 trials; give at most 10000 in all"):
        Sweep.model_validate({"vary": "seed", "values": list(range(10_001))})


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
