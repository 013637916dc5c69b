"""`megalopta spadcam compare` through its door: recordings beside a device's model."""

import numpy as np
import pytest

from megalopta.camera.comparison import align
from megalopta.camera.device_comparison import CompareSettings, compare_captured
from megalopta.camera.recording import Source, read_recorded
from megalopta.camera.stimuli import Cycle, Rendered
from megalopta.config.model import load
from megalopta.core.errors import UserError
from megalopta.sensor import expose_rate, load_sensor
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.formats.recorded_frames import tiff_writer
from megalopta.stages.run import run_stage

from ..small import small

pytestmark = pytest.mark.slow

LUX = 3e-4


@pytest.fixture(scope="module")
def forest(tmp_path_factory):
    """A rendered dataset of a few small frames."""
    out = tmp_path_factory.mktemp("scene") / "grating"
    return run_stage(out, load("grating", small(32, 32, 6, samples=4)), "render").root


@pytest.mark.parametrize(
    ("brighter", "words"),
    [(1.0, "No difference is statistically significant."), (1.2, "brightness 20 % higher")],
)
def test_a_rendered_scene_is_compared_frame_by_frame(forest, tmp_path, brighter, words):
    rate_hz = load("grating", {}).trajectory.frame_rate_hz
    path = tmp_path / "device.yaml"
    path.write_text(f"preset: ideal\nname: other\nexposure_s: {1 / rate_hz}\n")
    sensor = load_sensor(path)
    # frames that begin anywhere in the dataset, at its rate
    rates = brighter * Rendered(forest, LUX).rates_hz((3.4 + np.arange(240)) / rate_hz, sensor)
    counts = expose_rate(rates, sensor, seed=4, stream="seen").counts
    with tiff_writer(tmp_path / "seen.tif", counts.nbytes, 1 / rate_hz) as write:
        write(counts.astype(np.uint16))
    page = tmp_path / "page.html"
    source = Source(tmp_path / "seen.tif", LUX)
    sentence = compare_captured([source], path, page, CompareSettings(scene=str(forest)))
    assert words in sentence
    assert "aligned in time" in page.read_text("utf-8")


def test_a_range_of_frames_is_one_light(tmp_path):
    counts = np.arange(60)[:, None, None] * np.ones((1, 4, 4), np.uint16)
    np.save(tmp_path / "steps.npy", counts.astype(np.uint16))
    source = Source.parse(f"{tmp_path}/steps.npy#10-30@2e6:0.5")
    recorded = read_recorded(source)
    assert (source.light, recorded.exposure_s) == (2e6, 0.5)
    np.testing.assert_array_equal(recorded.counts, counts[10:30])
    with pytest.raises(UserError, match="it has 60"):
        read_recorded(Source.parse(f"{tmp_path}/steps.npy#10-99@2e6:0.5"))
    with pytest.raises(UserError, match="#FIRST-END"):
        Source.parse("steps#30@2e6")


def test_frames_of_other_sizes_are_refused():
    cycle = Cycle(np.ones((4, 16, 16)), 10.0)
    with pytest.raises(UserError, match="16"):
        align(Level(np.zeros((60, 8, 8)), 0.1), cycle)
