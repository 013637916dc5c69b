"""Light is baked once for a scene: a killed rendering taken up again, and others of it, share it."""

import os
import signal
import subprocess
import sys
import time

import pytest

from megalopta.render import choose_variant

SETTINGS = {
    "scene.trees": 8,
    "scene.density_per_ha": 80,
    "scene.undergrowth": 0,
    "camera.width": 24,
    "camera.height": 24,
    "trajectory.frames": 30,
    "render.samples_per_pixel": 9,
    "render.max_depth": 3,
    "render.integrator": "baked",
    "render.bake_error": 0.1,
}


def start(folder, cache, **settings):
    chosen = {**SETTINGS, **settings}
    options = [word for key, value in chosen.items() for word in (f"--{key}", str(value))]
    return subprocess.Popen(
        [sys.executable, "-m", "megalopta", "render", "demo", "--out", str(folder), *options],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        env={**os.environ, "XDG_CACHE_HOME": str(cache)},
    )


def finish(process):
    _, complaints = process.communicate()
    assert process.returncode == 0, complaints.decode()


def frames(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.glob("radiance/*/*.exr"))}


def light(cache):
    """The one file that light is kept in; a new bake would put another in its place."""
    (kept,) = (cache / "megalopta" / "light").glob("*.npz")
    return kept.stat().st_ino


@pytest.mark.slow
def test_light_is_baked_once_for_all_who_render_the_same(tmp_path):
    if choose_variant().name.startswith("scalar"):
        pytest.skip("baking needs a vectorized variant")
    here, there = tmp_path / "cache", tmp_path / "another cache"
    finish(start(tmp_path / "whole", here))
    whole, kept = frames(tmp_path / "whole"), light(here)
    finish(start(tmp_path / "second", here, name="second"))
    assert light(here) == kept
    assert list(frames(tmp_path / "second").values()) == list(whole.values())
    process = start(tmp_path / "broken", there)
    while process.poll() is None and len(frames(tmp_path / "broken")) < 2:
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert process.returncode == -signal.SIGKILL, "it was finished before it was killed"
    kept = light(there)
    finish(start(tmp_path / "broken", there))
    assert light(there) == kept
    assert frames(tmp_path / "broken") == whole
