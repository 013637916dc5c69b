"""Responses to the plate that a camera recorded, beside those of its model."""

import numpy as np
import pytest

from megalopta.camera.comparison import Compared, plate_responses
from megalopta.camera.device_comparison import write_comparison_report, write_motion_report
from megalopta.camera.motion_bench import BenchLight, fitted_light, record
from megalopta.core.errors import UserError
from megalopta.sensor import preset
from megalopta.sensor.compare.counted import CountedFrames
from megalopta.sensor.compare.recordings import compare_recordings

SENSOR = preset("spadcam")


@pytest.mark.slow
def test_a_camera_of_half_the_signal_responds_half_as_much(tmp_path):
    counts = record(5.0, SENSOR).counts // 2
    responses = plate_responses({5.0: CountedFrames(counts, 0.1)}, SENSOR, margin=0.05)
    sizes = {each.name: each.difference.relative for each in responses}
    # a sum of responses halves, a product is a quarter; halves are rounded down
    assert sizes["NDS"] == pytest.approx(-0.5, abs=0.05)
    assert sizes["NDM"] == pytest.approx(-0.75, abs=0.05)
    sentence = write_motion_report(tmp_path / "plate.html", "half", responses)
    assert "NDM response at 5 mm/s" in sentence


def test_a_recording_may_begin_anywhere():
    counts = record(5.0, SENSOR, seed=1).counts
    begun = CountedFrames(counts[150:500], 0.1, times_s=3.7 + 0.1 * np.arange(350))
    responses = plate_responses({5.0: begun}, SENSOR, margin=0.05)
    # passages of 64 frames begin at 192, 256, 320 and 384
    assert [each.captured.size for each in responses] == [8, 8]
    # Welch's test at 1e-6, of the same device
    assert min(each.difference.p for each in responses) > 1e-6


@pytest.mark.slow
def test_passages_with_gaps_are_left_out():
    counts = record(5.0, SENSOR, seed=1).counts[:256]
    kept = np.delete(np.arange(256), 70)
    frames = CountedFrames(counts[kept], 0.1, times_s=0.1 * kept)
    (first, _) = plate_responses({5.0: frames}, SENSOR, margin=0.05)
    assert first.captured.size == 6  # crossings of three passages of four


def test_short_recordings_are_refused():
    with pytest.raises(UserError, match="no edge passes"):
        plate_responses({5.0: CountedFrames(np.zeros((64, 16, 16)), 0.1)}, SENSOR, margin=0.05)


@pytest.mark.slow
def test_in_its_own_light_a_dimmer_bench_responds_like_its_model():
    light = BenchLight(open_photons=110.0, hidden_photons=20.0)
    frames = CountedFrames(record(5.0, SENSOR, light, seed=1).counts, 0.1)
    fitted = fitted_light(frames.counts, SENSOR)
    # of 16 passages, 8 frames and 256 pixels each: 33000 counts of some 130 on average, 0.1 %;
    # that edges are in the middle to a frame is another
    assert fitted == pytest.approx(light, rel=0.01)
    own = plate_responses({5.0: frames}, SENSOR, margin=0.05, own_light=True)
    assert min(each.difference.p for each in own) > 1e-6
    other = plate_responses({5.0: frames}, SENSOR, margin=0.05)
    assert max(each.difference.p for each in other) < 1e-6


@pytest.mark.slow
def test_a_row_that_differs_is_counted_and_both_maps_share_a_scale(tmp_path):
    rng = np.random.default_rng(3)
    one, other = rng.poisson(20.0, (2, 200, 8, 8)).astype(float)
    one[:, 2] += 10
    levels = [CountedFrames(one, 0.01)], [CountedFrames(other, 0.01)]
    found = compare_recordings(*levels)
    page = tmp_path / "page.html"
    write_comparison_report(page, "camera", Compared(*levels, found))
    html = page.read_text("utf-8")
    # 10 counts are 22 standard errors of a mean
    assert found.means.differs[0, 2].all()
    assert f"Of 64 pixels {found.means.differs.sum()} differ in the mean" in html
    assert f"the mean differs in {found.means.differs.sum()} of 64 pixels" in html
    assert html.count("captured less simulated (standard errors)") == 4  # title and description
