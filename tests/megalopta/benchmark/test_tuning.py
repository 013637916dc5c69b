"""Settings of gray methods for each light: what the routine chooses, and how boards use it."""

from itertools import product

import numpy as np
import pytest

from megalopta.benchmark import tuning
from megalopta.benchmark.clips import FlowClip, leaves_clip
from megalopta.benchmark.methods import block_detector
from megalopta.benchmark.whole_frames import MEAN, frame_errors
from megalopta.cli import main as cli
from megalopta.core import strict_yaml
from megalopta.flow import METHODS, optical_flow


@pytest.fixture(scope="module")
def clip():
    return leaves_clip(7, (96, 120))


def test_the_routine_finds_what_trying_all_settings_finds(clip):
    """DIS has few enough; that a single clip has one minimum was seen, not proven."""
    ((flux, found),) = tuning.tune("DIS", (10.0,), [clip]).items()
    parameter, values = tuning.PARAMETERS["DIS"]
    errors = []
    for noise, value in product(tuning.NOISE, values):
        detector = METHODS["DIS"].model_copy(update={**noise, parameter: value})
        board = frame_errors([clip], [detector], (flux,))
        errors.append(board.over_scenes(MEAN, board.detectors[0], flux).value)
    assert found["error_px"] == pytest.approx(min(errors), abs=1e-4)  # rounded so
    assert min(errors) < np.median(errors)


@pytest.mark.parametrize("name", tuning.PARAMETERS)
def test_a_tuned_method_has_the_settings_for_the_nearest_light(name, clip):
    parameter, _ = tuning.PARAMETERS[name]
    for flux, nearest in ((0.4, 1.0), (12.0, 10.0), (1e5, 1000.0)):
        first, second = clip.counts(flux, 0)[3:5]
        row = tuning.tuned_settings()[name][nearest]
        settings = {key: row[key] for key in ("stretch", "blur_px", parameter)}
        np.testing.assert_array_equal(
            optical_flow(first, second, tuning.tuned(name)),
            optical_flow(first, second, name, **settings),
        )


def test_boards_name_tuned_methods_as_such_and_measure_their_blocks(clip):
    board = frame_errors([clip], ["FB tuned"], (10.0,))
    (detector,) = board.detectors
    assert detector == block_detector("FB tuned") and detector.name == "FB tuned"
    row = tuning.tuned_settings()["FB"][10.0]
    settings = {key: value for key, value in row.items() if key != "error_px"}
    plain = frame_errors([clip], [METHODS["FB"].model_copy(update=settings)], (10.0,))
    found, expected = (each.of_scenes(MEAN, each.detectors[0], 10.0) for each in (board, plain))
    np.testing.assert_array_equal(found, expected)


def test_tuning_scenes_are_not_those_of_boards():
    names = [clip.name for clip in tuning.tuning_clips((96, 96))]
    assert len(set(names)) == 8 and not {f"leaves {seed}" for seed in range(200)} & set(names)
    reported = {"astronaut", "camera", "chelsea", "coffee", "rocket", "gravel"}
    assert not reported & set(tuning.PICTURES)


def test_the_command_keeps_other_methods_of_the_file(clip, tmp_path, capsys, monkeypatch):
    small = FlowClip("small", clip.light, clip.flow)
    monkeypatch.setattr(tuning, "tuning_clips", lambda: [small])
    out = tmp_path / "tuned.yaml"
    for name in ("LK", "DIS"):
        cli.main(["benchmark", "tune", name, "--photons", "100", "--out", str(out)])
    found = strict_yaml.load(out.read_text())
    assert list(found) == ["LK", "DIS"] and found["LK"][100.0]["window_blocks"] > 0
    assert "100 photons: stretch" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        cli.main(["benchmark", "tune", "PF"])
    assert "invalid choice: 'PF'" in capsys.readouterr().err
