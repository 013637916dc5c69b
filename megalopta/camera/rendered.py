"""Frames of a dataset, for an emulated camera to look at."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from megalopta.camera.stimuli import frames_at
from megalopta.config.light_scale import light_scale
from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.dataset.frames import read_radiance_frame
from megalopta.dataset.store import open_sequence
from megalopta.sensor import Sensor, detection_rate
from megalopta.sensor.spadcam.messages import COLUMNS, ROWS


@dataclass(frozen=True)
class Rendered:
    """Frames of a dataset, at their rate, over and over: the middle square, averaged to 16 × 16."""

    path: Path
    lux: float | None = None
    """Light level; by default that of the rendering."""

    def rates_hz(self, times_s: Floats, sensor: Sensor) -> Floats:
        """As of a stimulus. Raises UserError when the dataset cannot be read or is too small."""
        frame_rate_hz, frames, bands = _rendered(self)
        return frames_at(times_s, frame_rate_hz, detection_rate(frames, bands, sensor))


@cache
def _rendered(scene: Rendered) -> tuple[float, Floats, tuple[tuple[float, float], ...]]:
    dataset = open_sequence(scene.path)
    configuration = dataset.configuration
    side = min(configuration.camera.height, configuration.camera.width) // ROWS * ROWS
    if side == 0:
        raise UserError(f"{scene.path}: smaller than 16 × 16 pixels; render it larger")
    scale = 1.0 if scene.lux is None else light_scale(configuration, scene.lux)
    frames = [
        _shrunk(read_radiance_frame(dataset, index), side) * scale
        for index in range(configuration.trajectory.frames)
    ]
    bands = configuration.render.bands_nm
    return configuration.trajectory.frame_rate_hz, np.array(frames, np.float64), bands


def _shrunk(image: NDArray[np.float32], side: int) -> Floats:
    """Mean over the blocks of the middle square, (16, 16, B)."""
    top, left = ((length - side) // 2 for length in image.shape[:2])
    block = side // ROWS
    square = image[top : top + side, left : left + side]
    blocks = square.reshape(ROWS, block, COLUMNS, block, -1)
    return np.asarray(blocks.mean(axis=(1, 3), dtype=np.float64))
