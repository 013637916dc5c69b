"""Stimuli of an emulated camera: uniform light, the plate of the motion bench, a rendered dataset.

The last two load scenes and the renderer on first use.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.sensor import Sensor, changed, detection_rate, photon_rate
from megalopta.sensor.formats.protocol import COLUMNS, ROWS

BAND_NM = (699.99, 700.01)
"""Band of the flat light, narrow like a laser's, so that efficiency is that of one wavelength."""


class Cycle(NamedTuple):
    """Detection rates of frames that repeat."""

    rates_hz: Floats
    """(n, rows, columns)"""
    frame_rate_hz: float


class Stimulus(ABC):
    """A stimulus: frames in an endless cycle."""

    @abstractmethod
    def film(self, sensor: Sensor) -> Cycle:
        """Return the frames (n, 16, 16). Raises UserError."""

    def rates_hz(self, times_s: Floats, sensor: Sensor) -> Floats:
        """Detection rates (n, 16, 16), Hz, of frames that begin at these times."""
        frames, rate_hz = self.film(sensor)
        # A frame that begins early by a rounding error is not the previous one.
        return np.asarray(frames[np.floor(times_s * rate_hz + 1e-6).astype(int) % len(frames)])


@dataclass(frozen=True)
class Flat(Stimulus):
    """The same light on all pixels: none, one level, or a cycle of levels."""

    photons_hz: tuple[float, ...] = (0.0,)
    """Photons per second on a pixel of pitch × pitch, at 700 nm; levels in a cycle."""
    step_s: float = math.inf
    """Duration of each level, s."""

    def film(self, sensor: Sensor) -> Cycle:
        """Return a frame for each level."""
        rates_hz = np.array(self.photons_hz)[:, None, None] * _efficiency(sensor)
        return Cycle(rates_hz, 1 / self.step_s)


@cache
def _efficiency(sensor: Sensor) -> Floats:
    """Return the detected share of the photons on each pixel, (16, 16)."""
    light = np.ones((1, ROWS, COLUMNS, 1))
    photons = photon_rate(light, (BAND_NM,), sensor)
    return np.asarray((detection_rate(light, (BAND_NM,), sensor) / photons)[0])


@dataclass(frozen=True)
class Plate(Stimulus):
    """The plate of the motion bench (§2.4.8), frame by frame at 10 per second.

    In its light an open pixel detects 65 photons in 0.1 s.
    """

    speed_mm_s: float

    def film(self, sensor: Sensor) -> Cycle:
        """Return the frames of a passage to and fro."""
        return _passing(self.speed_mm_s, sensor)


@cache
def _passing(speed_mm_s: float, sensor: Sensor) -> Cycle:
    from megalopta.camera.motion_bench import FRAME_RATE_HZ, passing_rates

    as_lit = changed(sensor, exposure_s=1 / FRAME_RATE_HZ)
    return Cycle(passing_rates(speed_mm_s, as_lit), FRAME_RATE_HZ)


@dataclass(frozen=True)
class Rendered(Stimulus):
    """Frames of a dataset, at their rate: the middle square, averaged to 16 × 16."""

    path: Path
    lux: float | None = None
    """Light level; default: that of the rendering."""

    def film(self, sensor: Sensor) -> Cycle:
        """Return the frames of the dataset, which must be readable and large enough."""
        frame_rate_hz, frames, bands = _rendered(self)
        return Cycle(detection_rate(frames, bands, sensor), frame_rate_hz)


@cache
def _rendered(scene: Rendered) -> tuple[float, Floats, tuple[tuple[float, float], ...]]:
    from megalopta.config.light_scale import light_scale
    from megalopta.dataset.frames import read_radiance_frame
    from megalopta.dataset.store import open_sequence

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
    """Return the mean over the blocks of the middle square, (16, 16, B)."""
    top, left = ((length - side) // 2 for length in image.shape[:2])
    block = side // ROWS
    square = image[top : top + side, left : left + side]
    blocks = square.reshape(ROWS, block, COLUMNS, block, -1)
    return np.asarray(blocks.mean(axis=(1, 3), dtype=np.float64))
