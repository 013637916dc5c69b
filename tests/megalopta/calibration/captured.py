"""Recordings as a capture leaves them, of a device that is known."""

import numpy as np
import yaml
import zarr

from megalopta.sensor import Exposure, StoredCounts, changed, write_counts


def write_recording(folder, sensor, level):
    """Write codes of a level as a recording."""
    folder.mkdir(parents=True)
    codes = level.codes
    exposure = Exposure(np.zeros(codes.shape, np.uint16), np.zeros(codes.shape, bool))
    own = changed(sensor, exposure_s=level.exposure_s)
    stored = StoredCounts(sensor=own, seed=0, sequence="flat", exposure=exposure)
    write_counts(folder / "counts.zarr", stored)
    zarr.open_group(folder / "counts.zarr", mode="a").create_array("adc", data=codes)
    settings = {"kind": "flat", "exposure_s": level.exposure_s}
    (folder / "recording.yaml").write_text(yaml.safe_dump(settings), "utf-8")
    return folder
