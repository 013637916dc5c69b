"""Stimuli of an emulated camera: detection rates of its 16 × 16 pixels, Hz, at any times.

Plate and datasets load scenes and the renderer when they are first asked; even light does without.
"""

import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.core.errors import UserError
from megalopta.sensor import Sensor, changed, detection_rate, photon_rate
from megalopta.sensor.formats.protocol import COLUMNS, ROWS

BAND_NM = (699.99, 700.01)
"""Of the flat light: as narrow as a laser, so that its efficiency is that of one wavelength."""


class Stimulus(Protocol):
    """Anything to look at."""

    def rates_hz(self, times_s: Floats, sensor: Sensor) -> Floats:
        """Detection rates (n, 16, 16), Hz, of frames that begin at these times."""


@dataclass(frozen=True)
class Flat:
    """The same light on all pixels: none, one level, or levels that follow one another.

    Attributes
    ----------
    photons_hz : tuple of float
        Photons per second on a pixel of pitch × pitch, at 700 nm; after the last the first again.
    step_s : float
        How long each lasts, s.
    """

    photons_hz: tuple[float, ...] = (0.0,)
    step_s: float = math.inf

    def rates_hz(self, times_s: Floats, sensor: Sensor) -> Floats:
        """As of a stimulus."""
        levels = np.array(self.photons_hz)[
            (times_s // self.step_s).astype(int) % len(self.photons_hz)
        ]
        return np.asarray(levels[:, None, None] * _efficiency(sensor))


def _frames_at(times_s: Floats, frame_rate_hz: float, frames: Floats) -> Floats:
    """Return frames of a rate, over and over, at these times, (n, 16, 16)."""
    # A frame that begins a rounding error early is not the one before.
    return np.asarray(frames[np.floor(times_s * frame_rate_hz + 1e-6).astype(int) % len(frames)])


@cache
def _efficiency(sensor: Sensor) -> Floats:
    """Return the share of the photons on each pixel that it detects, (16, 16)."""
    light = np.ones((1, ROWS, COLUMNS, 1))
    photons = photon_rate(light, (BAND_NM,), sensor)
    return np.asarray((detection_rate(light, (BAND_NM,), sensor) / photons)[0])


@dataclass(frozen=True)
class Plate:
    """The plate of the motion bench (§2.4.8), frame by frame at 10 per second, over and over.

    The light is such that an open pixel detects 65 photons in 0.1 s.
    """

    speed_mm_s: float

    def rates_hz(self, times_s: Floats, sensor: Sensor) -> Floats:
        """As of a stimulus."""
        from megalopta.camera.motion_bench import FRAME_RATE_HZ

        as_lit = changed(sensor, exposure_s=1 / FRAME_RATE_HZ)
        return _frames_at(times_s, FRAME_RATE_HZ, _passing(self.speed_mm_s, as_lit))


@cache
def _passing(speed_mm_s: float, sensor: Sensor) -> Floats:
    from megalopta.camera.motion_bench import passing_rates

    return passing_rates(speed_mm_s, sensor)


@dataclass(frozen=True)
class Rendered:
    """Frames of a dataset, at their rate, over and over: the middle square, averaged to 16 × 16."""

    path: Path
    lux: float | None = None
    """Light level; by default that of the rendering."""

    def rates_hz(self, times_s: Floats, sensor: Sensor) -> Floats:
        """As of a stimulus. Raises UserError when the dataset cannot be read or is too small."""
        frame_rate_hz, frames, bands = _rendered(self)
        return _frames_at(times_s, frame_rate_hz, detection_rate(frames, bands, sensor))


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
