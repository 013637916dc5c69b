"""Recordings as a capture leaves them."""

import numpy as np

from megalopta.camera.recording import FRAMES, RECORD, RecordingSettings, write_settings


def write_recording(folder, sensor, adc, period_s=0.1, rows=16):
    """Write codes of the ADC (n, 16, 16), a frame each period; return the folder."""
    folder.mkdir()
    records, number = np.zeros(len(adc), RECORD), np.arange(len(adc))
    records["adc"], records["sequence"] = adc, number
    records["device_us"] = np.round(1e6 * period_s * (number + 0.5))
    records["host_s"] = period_s * (number + 0.5)
    (folder / FRAMES).write_bytes(records.tobytes())
    stated = {
        **{"kind": "flat", "started": "2026-01-01T00:00:00+00:00", "finished": True},
        **{"serial_number": "1", "firmware": "1.0", "exposure_s": sensor.exposure_s},
        **{"frame_rate_hz": 1 / period_s, "step_bias": 2048, "row_window": (0, rows)},
    }
    write_settings(folder, RecordingSettings(**stated, sensor=sensor))
    return folder
