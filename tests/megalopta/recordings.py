"""Recordings as a capture leaves them."""

import numpy as np
import yaml
import zarr

from megalopta.sensor import Exposure, StoredCounts, write_counts


def write_recording(folder, sensor, exposure, adc, period_s=0.1, rows=16):
    """Write counts (n, 16, 16) with the codes of their ADC, a frame each period; return the folder."""
    folder.mkdir()
    stored = StoredCounts(sensor=sensor, seed=0, sequence="flat", exposure=Exposure(*exposure))
    write_counts(folder / "counts.zarr", stored)
    group, number = zarr.open_group(folder / "counts.zarr", mode="a"), np.arange(len(adc))
    times = {"times_s": period_s * (number + 0.5), "device_us": round(1e6 * period_s) * number}
    for name, values in {"adc": adc, "sequence_number": number, **times}.items():
        group.create_array(name, data=values)
    settings = {
        **{"kind": "flat", "started": "2026-01-01T00:00:00+00:00", "finished": True},
        **{"serial_number": "1", "firmware": "1.0", "exposure_s": sensor.exposure_s},
        **{"frame_rate_hz": 1 / period_s, "step_bias": 2048, "row_window": [0, rows]},
    }
    (folder / "recording.yaml").write_text(yaml.safe_dump(settings), "utf-8")
    return folder
