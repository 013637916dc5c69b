"""Responses to the plate that a camera recorded, beside those of its model."""

import numpy as np
import pytest

from megalopta.comparison import plate_responses, write_motion_report
from megalopta.errors import UserError
from megalopta.experiments import record
from megalopta.sensor import preset
from megalopta.sensor.compare import CountedFrames

SENSOR = preset("spadcam")


def test_a_camera_of_half_the_signal_responds_half_as_much(tmp_path):
    counts = record(5.0, SENSOR).counts // 2
    responses = plate_responses({5.0: CountedFrames(counts, 0.1)}, SENSOR, margin=0.05)
    sizes = {each.name: each.difference.relative for each in responses}
    # a sum of responses halves, a product is a quarter; halves are rounded down
    assert sizes["NDS"] == pytest.approx(-0.5, abs=0.05)
    assert sizes["NDM"] == pytest.approx(-0.75, abs=0.05)
    sentence = write_motion_report(tmp_path / "plate.html", "half", responses)
    assert "NDM response at 5 mm/s" in sentence


def test_short_recordings_are_refused():
    with pytest.raises(UserError, match="128 frames"):
        plate_responses({5.0: CountedFrames(np.zeros((64, 16, 16)), 0.1)}, SENSOR, margin=0.05)
