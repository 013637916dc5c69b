"""Figures of the motion bench, captured beside simulated."""

import pytest

from megalopta.camera.motion_bench import record
from megalopta.reproduction.captured_edge import captured_figures
from megalopta.sensor import changed, preset

pytestmark = pytest.mark.slow

SENSOR = preset("spadcam")
NAMES = ["fig-2.14-to-2.17", "fig-2.18-and-2.19"]


@pytest.mark.parametrize("divisor", [1, 2])
def test_a_camera_of_a_share_of_the_signal_differs_by_that(divisor):
    counts = record(10.0, SENSOR).counts // divisor
    figures = list(captured_figures({10.0: counts}, SENSOR))
    assert [figure.name for figure in figures] == NAMES
    numbers = figures[-1].numbers.iloc[0]
    for method, power in (("NDS", 1), ("NDM", 2)):
        # halves are rounded down
        ratio = numbers[f"captured_{method}_mean"] / numbers[f"simulated_{method}_mean"]
        assert ratio == pytest.approx(1 / divisor**power, abs=0.05)


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
