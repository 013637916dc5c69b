"""What a capture shows."""

import numpy as np

from megalopta.camera.capturing import State, status_line
from megalopta.camera.recording import RecordingSettings

RECORD = RecordingSettings(
    kind="dark",
    started="2026-01-01T00:00:00+00:00",
    serial_number="A",
    firmware="f",
    exposure_s=0.05,
    frame_rate_hz=10,
    step_bias=2048,
    row_window=(0, 16),
    gaps=2,
    missing_frames=7,
    damaged_packets=1,
)


def state(plugged=True):
    counts = np.arange(256, dtype=np.uint16).reshape(16, 16)
    return State(RECORD, 120, 9.98, plugged, counts, counts > 250)


def test_a_line_tells_frames_rate_gaps_damage_and_saturated_pixels():
    line = status_line(state())
    assert line == (
        "120 frames, 10.0 frames/s, 2 gaps (7 frames missing), 1 packets damaged, "
        "5 pixels saturated"
    )
    assert status_line(state(plugged=False)).endswith("unplugged, waiting for it")
