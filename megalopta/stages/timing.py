"""How light and sensors go on within frames and from frame to frame: what `sense` needs of it."""

import numpy as np
from numpy.typing import NDArray

from megalopta.config.model import Configuration
from megalopta.dataset.frames import read_radiance_frame, read_truth_frame
from megalopta.dataset.store import Dataset
from megalopta.sensor.spad.model import Sensor
from megalopta.sensor.sub_frames import NextFrames


def next_frames(dataset: Dataset, first: int, radiance: NDArray[np.float32]) -> NextFrames | None:
    """Return what follows frames (n, H, W, B) from a number on; None where light stands still.

    After the last frame of the sequence the light moves on as it came.
    """
    settings, end = dataset.configuration, first + len(radiance)
    if settings.sub_frames == 1:
        return None
    truths = [read_truth_frame(dataset, index) for index in range(first, end)]
    flow = np.stack([truth.flow_forward for truth in truths])
    hidden = np.stack([truth.occluded_forward for truth in truths])
    if end == settings.trajectory.frames:
        flow[-1], hidden[-1] = -truths[-1].flow_backward, True
        after = radiance[-1]
    else:
        after = read_radiance_frame(dataset, end)
    following = np.concatenate((radiance[1:], after[np.newaxis]))
    return NextFrames(radiance=following, flow=flow, hidden=hidden)


def burst_frames(settings: Configuration) -> int:
    """Binary frames of a burst from one rendered frame to the next."""
    return max(round(settings.burst_hz / settings.trajectory.frame_rate_hz), 1)


def check_timing(settings: Configuration) -> None:
    """Refuse exposures, moving light, bursts and free-running arrays that do not fit into frames.

    Raises ValueError, with one sentence that names the setting, or the sensor.
    """
    _check_sub_frames(settings)
    rate_hz = settings.trajectory.frame_rate_hz
    for sensor in settings.sensors:
        if settings.free_running and not isinstance(sensor, Sensor):
            raise ValueError(
                f"free_running: sensor {sensor.name!r} integrates and is reset in every frame; "
                "take the setting or the sensor out"
            )
        if settings.free_running and abs(sensor.exposure_s * rate_hz - 1) > 1e-9:
            raise ValueError(
                f"free_running: sensor {sensor.name!r} with exposure_s {sensor.exposure_s:g} does "
                f"not fill frames at trajectory.frame_rate_hz {rate_hz:g}; use exposure_s "
                f"{1 / rate_hz:.12g}, or leave the setting out"
            )
        if sensor.exposure_s * rate_hz > 1 + 1e-9:
            raise ValueError(
                f"sensor {sensor.name!r}: exposure_s {sensor.exposure_s:g} is longer than a frame "
                f"at trajectory.frame_rate_hz {rate_hz:g}; use at most {1 / rate_hz:g}"
            )


def _check_sub_frames(settings: Configuration) -> None:
    """Refuse light that would be blurred twice, and bursts that do not fill the time."""
    parts, rate_hz = settings.sub_frames, settings.trajectory.frame_rate_hz
    if parts > 1 and not settings.shutter.is_instant:
        raise ValueError(
            f"sub_frames {parts}: motion within an exposure is in the frames of shutter already; "
            "use 1, or shutter.exposure_s 0 and shutter.readout_s 0"
        )
    if "burst_npy" not in settings.products:
        return
    if parts == 1:
        raise ValueError("burst_npy: needs light between frames; give sub_frames of 2 or more")
    if abs(burst_frames(settings) * rate_hz / settings.burst_hz - 1) > 1e-9:
        raise ValueError(
            f"burst_hz {settings.burst_hz:g}: no whole multiple of trajectory.frame_rate_hz "
            f"{rate_hz:g}; use {burst_frames(settings) * rate_hz:.12g}"
        )
