"""Recordings that are damaged or from somebody else: one sentence, and nothing beside is touched."""

import os
import shutil
import signal

import numpy as np
import pytest

from megalopta.camera.recorder import Recorder
from megalopta.sensor import preset
from megalopta.sensor.formats.protocol import Identity, Settings, frame_packet

from ..harm import BOMB, replaced
from .conftest import said_of


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A recording of 50 frames."""
    folder = tmp_path_factory.mktemp("made") / "a"
    folder.mkdir()
    identity = Identity(16, 16, 12, 3300, "A", "test 1")
    recorder = Recorder(folder, preset("spadcam"), "dark", identity, Settings(), 0.0)
    recorder.plugged()
    adc = np.random.default_rng(0).integers(500, 4096, (50, 16, 16)).astype(np.uint16)
    for number, samples in enumerate(adc):
        recorder.take(number / 10, frame_packet(number, 100_000 * number, samples))
    recorder.finish(0)
    return folder


def yaml_of(recording, change):
    path = recording / "recording.yaml"
    path.write_text(change(path.read_text("utf-8")), "utf-8")


DAMAGE = {
    "link": lambda a: replaced(a / "frames.bin", lambda p: p.symlink_to("/etc/passwd")),
    "link to settings": lambda a: replaced(a / "recording.yaml", lambda p: p.symlink_to("/dev/zero")),
    "pipe as settings": lambda a: replaced(a / "recording.yaml", os.mkfifo),
    "pipe as frames": lambda a: replaced(a / "frames.bin", os.mkfifo),
    "wrong yaml": lambda a: yaml_of(a, lambda text: "kind: [dark"),
    "yaml that is no mapping": lambda a: yaml_of(a, lambda text: "3"),
    "yaml of 5 MB": lambda a: yaml_of(a, lambda text: text + "# " + "x" * 5_000_000),
    "yaml with a bomb": lambda a: yaml_of(a, lambda text: f"{BOMB}kind: *j"),
    "yaml nested": lambda a: yaml_of(a, lambda text: "kind: " + "[" * 400),
    "newer": lambda a: yaml_of(a, lambda text: text.replace("format: 2", "format: 99")),
    "older": lambda a: yaml_of(a, lambda text: text.replace("format: 2", "format: 1")),
    "format of words": lambda a: yaml_of(a, lambda text: text.replace("format: 2", "format: x")),
    "exposure": lambda a: yaml_of(a, lambda text: text.replace("exposure_s: 0.05", "exposure_s: -1")),
    "other sensor": lambda a: yaml_of(a, lambda text: text.replace("kind: analog", "kind: digital")),
    "no frames": lambda a: (a / "frames.bin").unlink(),
    "no times": lambda a: (a / "frames.bin").write_bytes(b"\xff" * 5360),
}  # fmt: skip
VERBS = {
    "calibrate": ["a", "--out", "b.yaml"],
    "compare": ["a", "--device", "device.yaml", "--out", "b.html"],
    "figures": ["a@1", "--out", "b"],
}


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_recording_is_told_in_one_sentence(
    made, tmp_path, monkeypatch, refused, damage, verb
):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(made, "a")
    (tmp_path / "device.yaml").write_text("preset: spadcam\nname: mine\n")
    DAMAGE[damage](tmp_path / "a")
    before = sorted(tmp_path.iterdir())
    signal.alarm(60)
    lines = said_of(refused("spadcam", verb, *VERBS[verb]))
    signal.alarm(0)
    assert lines[-1].startswith("megalopta: ")
    assert len(lines) == 1 or (len(lines) == 2 and "not finished" in lines[0])
    assert sorted(tmp_path.iterdir()) == before
