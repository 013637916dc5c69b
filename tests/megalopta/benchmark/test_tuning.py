"""Settings of gray methods for each light: what the routine chooses, and how boards use it."""

import signal
import subprocess
import sys
import time
from itertools import product

import numpy as np
import pytest

from megalopta.benchmark import tuned_method, tuning
from megalopta.benchmark.clips import FlowClip, leaves_clip
from megalopta.benchmark.methods import block_detector
from megalopta.benchmark.whole_frames import MEAN, frame_errors
from megalopta.cli import main as cli
from megalopta.core import strict_yaml
from megalopta.flow import METHODS, optical_flow

from ..small import counting


@pytest.fixture(scope="module")
def clip():
    return leaves_clip(7, (96, 120))


def test_the_routine_finds_what_trying_all_settings_finds(clip):
    """DIS has few enough; that a single clip has one minimum was seen, not proven."""
    ((flux, found),) = tuning.tune("DIS", (10.0,), [clip]).items()
    parameter, values = tuned_method.PARAMETERS["DIS"]
    errors = []
    for noise, value in product(tuning.NOISE, values):
        detector = METHODS["DIS"].model_copy(update={**noise, parameter: value})
        board = frame_errors([clip], [detector], (flux,))
        errors.append(board.over_scenes(MEAN, board.detectors[0], flux).value)
    assert found["error_px"] == pytest.approx(min(errors), abs=1e-4)  # rounded so
    assert min(errors) < np.median(errors)


@pytest.mark.parametrize("name", tuned_method.PARAMETERS)
def test_a_tuned_method_has_the_settings_for_the_nearest_light(name, clip):
    parameter, _ = tuned_method.PARAMETERS[name]
    for flux, nearest in ((0.4, 1.0), (12.0, 10.0), (1e5, 1000.0)):
        first, second = clip.counts(flux, 0)[3:5]
        row = tuned_method.tuned_settings()[name][nearest]
        settings = {key: row[key] for key in ("stretch", "blur_px", parameter)}
        np.testing.assert_array_equal(
            optical_flow(first, second, tuned_method.tuned(name)),
            optical_flow(first, second, name, **settings),
        )


def test_boards_name_tuned_methods_as_such_and_measure_their_blocks(clip):
    board = frame_errors([clip], ["FB tuned"], (10.0,))
    (detector,) = board.detectors
    assert detector == block_detector("FB tuned") and detector.name == "FB tuned"
    row = tuned_method.tuned_settings()["FB"][10.0]
    settings = {key: value for key, value in row.items() if key != "error_px"}
    plain = frame_errors([clip], [METHODS["FB"].model_copy(update=settings)], (10.0,))
    found, expected = (each.of_scenes(MEAN, each.detectors[0], 10.0) for each in (board, plain))
    np.testing.assert_array_equal(found, expected)


def test_tuning_scenes_are_not_those_of_boards():
    reported = {"astronaut", "camera", "chelsea", "coffee", "rocket", "gravel"}
    assert not reported & set(tuning.PICTURES) and not set(range(200)) & set(tuning.LEAVES)


def test_the_command_keeps_other_methods_of_the_file(clip, tmp_path, capsys, monkeypatch, refused):
    small = FlowClip("small", clip.light, clip.flow)
    monkeypatch.setattr(tuning, "tuning_clips", lambda: [small])
    out = tmp_path / "tuned.yaml"
    for name in ("LK", "DIS"):
        cli.main(["benchmark", "tune", name, "--photons", "100", "--out", str(out)])
    found = strict_yaml.load(out.read_text())
    assert list(found) == ["LK", "DIS"] and found["LK"][100.0]["window_blocks"] > 0
    assert "100 photons: stretch" in capsys.readouterr().out
    assert "PF takes no gray levels: give DIS" in refused("benchmark", "tune", "PF", "--out", out)


ENDLESS = """
import sys, time
from pathlib import Path
from megalopta.benchmark import tuning
from megalopta.benchmark.clips import leaves_clip

measure, count = tuning.frame_errors, 0

def hanging(*arguments):
    global count
    count += 1
    if count > 5:
        time.sleep(600)
    return measure(*arguments)

tuning.frame_errors = hanging
tuning.tuning_clips = lambda: [leaves_clip(7, (96, 120))]
tuning.write_tuned(Path(sys.argv[1]), "LK", (100.0,))
"""


def test_a_killed_run_goes_on_from_the_errors_that_it_had(clip, tmp_path, monkeypatch):
    out, errors = tmp_path / "tuned.yaml", tmp_path / "tuned-errors"
    process = subprocess.Popen([sys.executable, "-c", ENDLESS, str(out)])
    try:
        for _ in range(600):
            if len(list(errors.glob("*.npz"))) == 5:
                break
            time.sleep(0.1)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert len(list(errors.glob("*.npz"))) == 5 and not out.exists()
    whole = tuning.tune("LK", (100.0,), [clip])
    counted = counting(frame_errors, measured := [])
    monkeypatch.setattr("megalopta.benchmark.tuning.frame_errors", counted)
    monkeypatch.setattr(tuning, "tuning_clips", lambda: [clip])
    assert tuning.write_tuned(out, "LK", (100.0,)) == whole
    assert len(measured) == len(list(errors.glob("*.npz"))) - 5


def test_a_network_has_its_settings_next_to_its_file(clip, tmp_path, monkeypatch, capsys):
    onnx = pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    path, table = tmp_path / "still.onnx", tmp_path / "tuned.yaml"
    _write_network(onnx, path)
    for text in (None, "DIS: {}\n", "still.onnx: {10.0: {stretch: none}}\n"):
        if text:
            table.write_text(text)
        with pytest.raises(ValueError, match=f"run: megalopta benchmark tune {path}"):
            block_detector(f"{path} tuned")
    table.unlink()
    monkeypatch.setattr(tuning, "tuning_clips", lambda: [clip])
    cli.main(["benchmark", "tune", str(path), "--photons", "100", "--out", str(table)])
    assert "100 photons: stretch" in capsys.readouterr().out
    board = frame_errors([clip], [f"{path} tuned", f"{path} √"], (100.0,))
    assert [each.name for each in board.detectors] == ["still.onnx tuned", "still.onnx √"]


def _write_network(onnx, path):
    """Write a network that takes the difference of two pictures for the flow."""
    helper, kind = onnx.helper, onnx.TensorProto.FLOAT
    pictures = [helper.make_tensor_value_info(each, kind, [1, 1, "h", "w"]) for each in "ab"]
    flow = helper.make_tensor_value_info("flow", kind, [1, 2, "h", "w"])
    nodes = [
        helper.make_node("Sub", ["a", "b"], ["d"]),
        helper.make_node("Concat", ["d", "d"], ["flow"], axis=1),
    ]
    graph = helper.make_graph(nodes, "differences", pictures, [flow])
    onnx.save(
        helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8), path
    )
