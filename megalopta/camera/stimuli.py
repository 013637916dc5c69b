"""What an emulated camera looks at: detection rates of its 16 × 16 pixels, Hz, at any times.

Here even light; `plate` and `rendered` load the renderer's scenes, which even light does without.
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.sensor import Sensor, detection_rate, photon_rate
from megalopta.sensor.spadcam.messages import COLUMNS, ROWS

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


def frames_at(times_s: Floats, frame_rate_hz: float, frames: Floats) -> Floats:
    """Frames of a rate, over and over, at these times, (n, 16, 16)."""
    # A frame that begins a rounding error early is not the one before.
    return np.asarray(frames[np.floor(times_s * frame_rate_hz + 1e-6).astype(int) % len(frames)])


@cache
def _efficiency(sensor: Sensor) -> Floats:
    """Share of the photons on each pixel that it detects, (16, 16)."""
    light = np.ones((1, ROWS, COLUMNS, 1))
    photons = photon_rate(light, (BAND_NM,), sensor)
    return np.asarray((detection_rate(light, (BAND_NM,), sensor) / photons)[0])
