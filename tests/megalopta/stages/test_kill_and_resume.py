"""A rendering killed at any moment and taken up again equals the uninterrupted one.

`MEGALOPTA_LONG=1` runs it at full length: a forest of 400 frames at 240 × 240.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

IS_LONG = os.environ.get("MEGALOPTA_LONG") == "1"
FRAMES, PIXELS, TREES, KILLS = (400, 240, 130, 5) if IS_LONG else (30, 24, 8, 2)
SETTINGS = {
    "scene.trees": TREES,
    "scene.density_per_ha": 200 if IS_LONG else 80,
    "scene.undergrowth": 1 if IS_LONG else 0,
    "camera.width": PIXELS,
    "camera.height": PIXELS,
    "trajectory.frames": FRAMES,
    "trajectory.velocity_m_s": [0.2, 0, 0],
    "trajectory.rotation_deg_s": 1,
    "render.samples_per_pixel": 9,
    "render.max_depth": 3,
    "methods": ["BM"],
}


def start(folder: Path) -> "subprocess.Popen[bytes]":
    options = [word for key, value in SETTINGS.items() for word in (f"--{key}", str(value))]
    return subprocess.Popen(
        [sys.executable, "-m", "megalopta", "render", "demo", "--out", str(folder), *options],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )


def finish(process: "subprocess.Popen[bytes]") -> None:
    _, complaints = process.communicate()
    assert process.returncode == 0, complaints.decode()


def files(folder: Path) -> dict[str, bytes]:
    """All files but the clock's, by their path."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "timings.json"
    }


@pytest.mark.slow
def test_a_rendering_killed_at_random_moments_equals_the_uninterrupted_one_byte_for_byte(
    tmp_path: Path,
) -> None:
    rng = np.random.default_rng(4)
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    finish(start(whole))
    for moment in np.sort(rng.uniform(0, FRAMES, KILLS)):
        process = start(broken)
        while process.poll() is None:
            if len(list(broken.glob("radiance/*/*.exr"))) >= moment:
                time.sleep(rng.uniform(0, 0.05))  # somewhere inside the work on the next frame
                process.send_signal(signal.SIGKILL)
                break
            time.sleep(0.002)
        process.communicate()
        assert process.returncode == -signal.SIGKILL, "it was finished before it was killed"
    finish(start(broken))
    assert files(broken) == files(whole)
