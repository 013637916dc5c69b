"""The command line: what it answers, in this process, and what it is as a process of its own."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
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
    assert "interrupted; every file there is complete" in stderr
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


GRATING = (
    "--scene.kind grating --trajectory.velocity-m-s [0,0,0] --trajectory.look-at-m [9,0,1.5] "
    "--trajectory.frames 2 --camera.width 32 --camera.height 24"
).split()


def test_a_frame_is_exported_and_its_file_named(tmp_path, capsys, refused):
    path = tmp_path / "out" / "scene.glb"
    words = ["scene", "export", "demo", "--out", str(path), *GRATING]
    assert "frames are 0 to 1" in refused(*words, "--frame", "2")
    assert not path.parent.exists()
    cli.main([*words, "--frame", "1"])
    assert capsys.readouterr().out.strip() == str(path)
    assert [*trimesh.load_scene(path).graph.nodes_geometry] == ["grating 1"]


HIDING = """
import ast, importlib, sys
from pathlib import Path
import megalopta
from megalopta.core.errors import _EXTRAS

class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in _EXTRAS:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Hidden())
from megalopta.cli.main import VERBS, main

for verb in VERBS:
    try:
        main([*verb.split(), "--help"])
    except SystemExit as ended:
        assert not ended.code, verb
for path in (Path(megalopta.__file__).parent / "cli").glob("*.py"):
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module not in NEED_THE_RENDERER:
            module = importlib.import_module(node.module)
            for each in node.names:
                hasattr(module, each.name) or importlib.import_module(f"{node.module}.{each.name}")
for words in COMMANDS:
    main(words)
"""
NEED_THE_RENDERER = ("megalopta.stages.estimate", "megalopta.verification.truth")


@pytest.mark.slow
def test_without_extras_all_commands_start_and_those_of_files_work(tmp_path):
    """Nothing of an extra is imported by help, or where no renderer, port or encoder is used."""
    draw = np.random.default_rng(0).poisson
    for name, mean in (("dark_10ms", 5), ("flat_1e6_1ms", 400), ("flat_2e6_1ms", 800)):
        np.save(tmp_path / f"{name}.npy", draw(mean, (100, 8, 8)).astype(np.uint16))
    files = [str(path) for path in sorted(tmp_path.glob("*.npy"))]
    device, nm = str(tmp_path / "device.yaml"), ["--wavelength-nm", "550"]
    commands = [
        ["spadcam", "calibrate", *files, *nm, "--out", device],
        ["spadcam", "compare", *files, *nm, "--device", device, "--out", f"{tmp_path}/page.html"],
        ["sensor", device],
        ["view", files[0], "--out", f"{tmp_path}/view"],
        ["info"],
    ]
    code = f"NEED_THE_RENDERER, COMMANDS = {NEED_THE_RENDERER}, {commands}\n{HIDING}"
    line = [sys.executable, "-c", code]
    done = subprocess.run(line, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "frames agree" in done.stdout
