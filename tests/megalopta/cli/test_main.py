"""The command line: what it answers, in this process, and what it is as a process of its own."""

import os
import signal
import subprocess
import sys
import time

import pytest
import trimesh

from megalopta.cli import main as cli
from megalopta.config.model import load
from megalopta.render import read_radiance, read_truth

COMMAND = [sys.executable, "-m", "megalopta"]
SMALL = [
    "--camera.width=48", "--camera.height=40", "--render.samples-per-pixel=1",
    "--trajectory.frames=400", "--benchmark.sizes=[40]",
]  # fmt: skip


def test_info_names_versions_and_the_variant(capsys):
    cli.main(["info"])
    printed = capsys.readouterr().out
    assert "mitsuba" in printed and "_spectral" in printed


@pytest.mark.slow
def test_ctrl_c_leaves_whole_files_and_the_next_run_goes_on(refused, tmp_path):
    out = tmp_path / "data"
    process = subprocess.Popen(
        [*COMMAND, "render", "grating", *SMALL, "--out", str(out)],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
        # a shell that runs tests in the background has its children ignore Ctrl-C
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    deadline = time.monotonic() + 120
    while len([*out.rglob("truth/*/frame_*.exr")]) < 3 and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=30)
    assert process.returncode == 130, stderr
    assert "interrupted; every file is complete" in stderr
    assert "Traceback" not in stderr
    assert not [*out.rglob(".*")]
    truths = sorted(out.rglob("truth/*/frame_*.exr"))
    assert 3 <= len(truths) < 400
    for path in truths:
        read_truth(path)
    for path in out.rglob("radiance/*/*.exr"):
        read_radiance(path)
    assert "seed: 0 → 1" in refused("render", "grating", *SMALL, "--seed", "1", "--out", out)


def test_a_quick_demo_of_another_scene_has_no_settings_of_its_own(tmp_path):
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "box.stl")
    own = {"scene.kind": "meshes", "scene.files": str(tmp_path / "box.stl")}
    for given in own, {"scene": f"{{kind: meshes, files: {tmp_path / 'box.stl'}}}"}:
        made = load("quick", {**given, "camera.width": "40"})
        assert (made.scene.kind, made.camera.width, made.objects) == ("meshes", 40, ())
    assert len(load("quick").objects) == 3
