"""`megalopta spadcam compare`: a scene beside its simulation, and passages of the plate."""

from pathlib import Path

import numpy as np
import pytest

from megalopta.camera.comparison import CompareSettings, compare_captured, plate_responses
from megalopta.camera.comparison_page import motion_page
from megalopta.camera.emulator import rendered
from megalopta.camera.motion_bench import FRAMES, cut_passages, record
from megalopta.camera.sources import Source
from megalopta.config.model import load
from megalopta.core.errors import UserError
from megalopta.sensor import expose_rate, load_sensor, preset
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.formats.recorded_frames import tiff_writer
from megalopta.stages.run import run_stage

from ..small import small

LUX = 3e-4


@pytest.fixture(scope="module")
def forest(tmp_path_factory):
    """A rendered dataset of a few small frames."""
    out = tmp_path_factory.mktemp("scene") / "grating"
    return run_stage(out, load("grating", small(32, 32, 6, samples=4)), "render").root


@pytest.mark.slow
@pytest.mark.parametrize(
    ("brighter", "words"),
    [
        (1.0, "frames agree: no difference is statistically significant; equal within"),
        (1.2, " % higher (95 % CI)."),
    ],
)
def test_a_rendered_scene_is_compared_frame_by_frame(forest, tmp_path, brighter, words):
    rate_hz = load("grating", {}).trajectory.frame_rate_hz
    path = tmp_path / "device.yaml"
    path.write_text(f"preset: ideal\nname: other\nexposure_s: {1 / rate_hz}\n")
    sensor = load_sensor(path)
    # frames that begin anywhere in the dataset, at its rate
    rates = brighter * rendered(sensor, forest, LUX).at((3.4 + np.arange(240)) / rate_hz)
    counts = expose_rate(rates, sensor, seed=4, stream="seen").counts
    with tiff_writer(tmp_path / "seen.tif", counts.nbytes, 1 / rate_hz) as write:
        write(counts.astype(np.uint16))
    page = tmp_path / "page.html"
    source = Source(path=tmp_path / "seen.tif", light=LUX)
    sentence = compare_captured([source], path, page, CompareSettings(scene=str(forest)))
    assert words in sentence
    assert "aligned in time" in page.read_text("utf-8")


RNG = np.random.default_rng(0)
OPEN, HIDDEN, DARK = 65.0, 27.0, 60.0


def level(frames, middles, velocity):
    """Share of 16 pixels that is free, frame by frame: edges in the middle at these times."""
    time = (np.arange(frames * 50) + 0.5) / 50
    hidden = np.zeros_like(time)
    for number, middle in enumerate(middles):
        passed = np.clip(0.5 + velocity * (time - middle) / 16, 0, 1)
        hidden += passed if number % 2 == 0 else -passed
    return 1 - hidden.reshape(frames, 50).mean(axis=1)


def recorded(frames, middles, velocity):
    mean = HIDDEN + (OPEN - HIDDEN) * level(frames, middles, velocity) + DARK
    return RNG.poisson(np.broadcast_to(mean[:, None, None], (frames, 16, 16)))


@pytest.mark.parametrize("velocity", [1.67, 5.0, 16.7])
@pytest.mark.parametrize("at", [20.0, 33.3, 50.75])
def test_edges_are_in_the_middle_of_what_is_cut(velocity, at):
    middles = [at, at + 40.5, at + 85, at + 121.2]
    counts = recorded(220, middles, velocity)
    cut = cut_passages(counts).reshape(4, FRAMES, 16, 16)
    for middle, frames in zip(middles, cut, strict=True):
        # The array's mean has σ 0.6 counts, 0.15 frames of the slowest edge; 6 σ beyond a half.
        starts = [n for n in range(189) if (counts[n : n + FRAMES] == frames).all()]
        assert starts[0] == pytest.approx(middle - FRAMES / 2, abs=1.4)


def test_a_passage_begins_where_the_plate_hides():
    cut = cut_passages(recorded(250, [20, 60, 100, 140, 180, 220], 5.0)[45:])
    means = cut.reshape(2, 2, FRAMES, 16, 16).mean(axis=(0, 3, 4))
    np.testing.assert_allclose(means[0, [0, -1]], [OPEN + DARK, HIDDEN + DARK], rtol=0.03)
    np.testing.assert_allclose(means[1, [0, -1]], [HIDDEN + DARK, OPEN + DARK], rtol=0.03)


def test_what_shows_no_passages_is_refused():
    # Of a normal distribution 0.9 of the frames are within 3.3 σ, and 6 σ are asked for.
    still = recorded(300, [], 5.0)
    with pytest.raises(ValueError, match=r"no edge passes, the mean count is 12\d"):
        cut_passages(still)
    with pytest.raises(ValueError, match="1 passages of the plate to and fro in 130 frames"):
        cut_passages(recorded(130, [30, 70], 5.0))
    with pytest.raises(ValueError, match="an edge passes 20 frames after another"):
        cut_passages(recorded(200, [30, 70, 90, 130], 5.0))
    with pytest.raises(UserError, match="compare takes counts of SPAD arrays"):
        compare_captured([], Path("ixon-888"), Path("unwritten.html"), CompareSettings())


SENSOR = preset("spadcam")


@pytest.mark.slow
def test_a_camera_of_half_the_signal_responds_half_as_much():
    counts = record(5.0, SENSOR).counts // 2
    responses = plate_responses({5.0: Level(counts, 0.1)}, SENSOR, CompareSettings())
    sizes = {each.name: each.difference.relative for each in responses}
    # a sum of responses halves, a product is a quarter; halves are rounded down
    assert sizes["NDS"] == pytest.approx(-0.5, abs=0.05)
    assert sizes["NDM"] == pytest.approx(-0.75, abs=0.05)
    assert "NDM response at 5 mm/s" in motion_page("half", responses, 0.05)[1]


def test_a_recording_may_begin_anywhere():
    counts = record(5.0, SENSOR, seed=1).counts
    begun = Level(counts[150:500], 0.1, times_s=3.7 + 0.1 * np.arange(350))
    responses = plate_responses({5.0: begun}, SENSOR, CompareSettings())
    # passages of 64 frames begin at 192, 256, 320 and 384
    assert [each.captured.size for each in responses] == [8, 8]
    # Welch's test at 1e-6, of the same device
    assert min(each.difference.p for each in responses) > 1e-6
