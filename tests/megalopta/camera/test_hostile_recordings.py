"""Recordings that are damaged or from somebody else: one sentence, and nothing beside is touched."""

import json
import os
import shutil
import signal

import numpy as np
import pytest

from megalopta.camera.recorder import Recorder
from megalopta.camera.recording import open_recording
from megalopta.sensor import preset
from megalopta.sensor.formats.protocol import Identity, Settings, frame_packet

from ..harm import BOMB, replaced
from .conftest import said_of


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A recording that was killed, and its raw bytes."""
    folder = tmp_path_factory.mktemp("made") / "a"
    folder.mkdir()
    identity = Identity(16, 16, 12, 3300, "A", "test 1")
    recorder = Recorder(folder, preset("spadcam"), "dark", identity, Settings(), 0.0)
    recorder.plugged(0)
    adc = np.random.default_rng(0).integers(500, 4096, (50, 16, 16)).astype(np.uint16)
    for number, samples in enumerate(adc):
        recorder.take(number / 10, frame_packet(number, 100_000 * number, samples))
    recorder.write(0)
    (folder / "raw.bin").write_bytes(b"nothing")
    return folder


def yaml_of(recording, change):
    path = recording / "recording.yaml"
    path.write_text(change(path.read_text("utf-8")), "utf-8")


def claim(recording, name, **fields):
    path = recording / "counts.zarr" / "zarr.json"
    whole = json.loads(path.read_text("utf-8"))
    whole["consolidated_metadata"]["metadata"][name].update(fields)
    path.write_text(json.dumps(whole), "utf-8")


DAMAGE = {
    "link": lambda a: replaced(a / "counts.zarr" / "adc", lambda p: p.symlink_to("/etc")),
    "link to settings": lambda a: replaced(a / "recording.yaml", lambda p: p.symlink_to("/dev/zero")),
    "circular symbolic link": lambda a: (a / "more").symlink_to(a),
    "pipe as settings": lambda a: replaced(a / "recording.yaml", os.mkfifo),
    "pipe as a chunk": lambda a: replaced(a / "counts.zarr" / "adc" / "c" / "0" / "0" / "0", os.mkfifo),
    "wrong yaml": lambda a: yaml_of(a, lambda text: "kind: [dark"),
    "yaml that is no mapping": lambda a: yaml_of(a, lambda text: "3"),
    "yaml of 5 MB": lambda a: yaml_of(a, lambda text: text + "# " + "x" * 5_000_000),
    "yaml with a bomb": lambda a: yaml_of(a, lambda text: f"{BOMB}kind: *j"),
    "yaml nested": lambda a: yaml_of(a, lambda text: "kind: " + "[" * 400),
    "newer": lambda a: yaml_of(a, lambda text: text.replace("format: 1", "format: 99")),
    "format of words": lambda a: yaml_of(a, lambda text: text.replace("format: 1", "format: x")),
    "exposure": lambda a: yaml_of(a, lambda text: text.replace("exposure_s: 0.05", "exposure_s: -1")),
    "no counts": lambda a: shutil.rmtree(a / "counts.zarr"),
    "no chunk": lambda a: shutil.rmtree(a / "counts.zarr" / "adc" / "c"),
    "no times": lambda a: shutil.rmtree(a / "counts.zarr" / "times_s" / "c"),
    "huge": lambda a: [claim(a, n, shape=[10**12, 16, 16]) for n in ("counts", "saturated", "adc")],
    "other shape": lambda a: claim(a, "adc", shape=[50, 256]),
    "raw.bin is a pipe": lambda a: replaced(a / "raw.bin", os.mkfifo),
}  # fmt: skip
VERBS = {
    "calibrate": ["a", "--out", "b.yaml"],
    "compare": ["a", "--device", "device.yaml", "--out", "b.html"],
    "figures": ["a@1", "--out", "b"],
    "recover": ["a"],
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


def test_a_recording_has_a_format_and_older_ones_have_none(made, tmp_path):
    shutil.copytree(made, tmp_path / "a")
    text = (tmp_path / "a" / "recording.yaml").read_text("utf-8")
    assert text.startswith("format: 1\n")
    yaml_of(
        tmp_path / "a",
        lambda text: text.replace("format: 1\n", "").replace("recovered: false\n", ""),
    )
    assert len(open_recording(tmp_path / "a")) == 50


def test_what_was_not_finished_is_said(made, capsys):
    open_recording(made)
    told = capsys.readouterr().err
    assert f"{made}: not finished" in told and f"megalopta spadcam recover {made}" in told
