"""The motion bench through the emulated camera's line, beside the one simulated directly."""

from functools import partial

import pytest

from megalopta.camera.emulator import plate
from megalopta.camera.motion_bench import cut_passages, record
from megalopta.camera.recording import open_recording
from megalopta.cli import main as cli
from megalopta.reproduction.captured_edge import captured_figures
from megalopta.sensor import changed, preset

from ..camera.conftest import emulating

pytestmark = pytest.mark.slow

SENSOR = preset("spadcam")
NAMES = ["fig-2.14-to-2.17", "fig-2.18-and-2.19"]


@pytest.fixture
def recording(tmp_path, request, monkeypatch):
    """A recording of the plate at so many mm/s, from a camera whose clock runs 20 times as fast."""
    monkeypatch.setattr("signal.signal", lambda *_: None)  # the command puts in its own handlers
    link, out = tmp_path / "cam", tmp_path / "plate"
    with emulating(link, clock_rate=20.0, film=partial(plate, speed_mm_s=request.param), seed=3):
        words = f"--port {link} --kind plate --rate 10 --exposure 0.1 --frames 600 --out {out}"
        cli.main(["spadcam", "capture", *words.split()])
    return out


# capturing is tested by camera/test_capture.py, the figures below
@pytest.mark.parametrize("recording", [10.0], indirect=True)
def test_a_captured_bench_is_the_simulated_one_but_for_chance(recording):
    captured = open_recording(recording)
    sensor = changed(captured.settings.sensor, counter={"calibrated": False})
    figures = list(captured_figures({10.0: cut_passages(captured.counts[:])}, sensor))
    assert [figure.name for figure in figures] == NAMES
    numbers = figures[-1].numbers.iloc[0]
    for method in ("NDM", "NDS"):
        ratio = numbers[f"captured_{method}_mean"] / numbers[f"simulated_{method}_mean"]
        assert ratio == pytest.approx(1, rel=0.05)


def test_a_camera_of_half_the_signal_differs_by_half():
    counts = record(10.0, SENSOR).counts // 2
    *_, figure = captured_figures({10.0: counts}, SENSOR)
    numbers = figure.numbers.iloc[0]
    for method, share in (("NDS", 0.5), ("NDM", 0.25)):
        # halves are rounded down
        ratio = numbers[f"captured_{method}_mean"] / numbers[f"simulated_{method}_mean"]
        assert ratio == pytest.approx(share, abs=0.05)


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["{0}@0"], "no speed of the plate; give it with each recording"),
        (["{0}@5"], "capture with --rate 10 --exposure 0.1"),
        (["nothing@5"], "nothing: no such file; give the path of a recording"),
    ],
)
def test_what_cannot_be_drawn_is_told_before_anything_is_written(words, problem, tmp_path, refused):
    from megalopta.camera.recording import Recorder
    from megalopta.sensor.formats.protocol import Identity, Settings

    identity = Identity(16, 16, 12, 3300, "A", "test 1")
    sensor = changed(SENSOR, exposure_s=0.05)
    Recorder(tmp_path, sensor, "plate", identity, Settings(), 0.0).finish(0)
    given = [word.format(tmp_path) for word in words]
    assert problem in refused("spadcam", "figures", *given, "--out", tmp_path / "new")
    assert not (tmp_path / "new").exists()
