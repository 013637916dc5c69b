"""The moving plate of the motion bench, for an emulated camera to look at."""

from dataclasses import dataclass
from functools import cache

from megalopta.camera.motion_bench import FRAME_RATE_HZ, passing_rates
from megalopta.camera.stimuli import frames_at
from megalopta.core.arrays import Floats
from megalopta.sensor import Sensor, changed


@dataclass(frozen=True)
class Plate:
    """The plate of the motion bench (§2.4.8), frame by frame at 10 per second, over and over.

    The light is such that an open pixel detects 65 photons in 0.1 s.
    """

    speed_mm_s: float

    def rates_hz(self, times_s: Floats, sensor: Sensor) -> Floats:
        """As of a stimulus."""
        as_lit = changed(sensor, exposure_s=1 / FRAME_RATE_HZ)
        return frames_at(times_s, FRAME_RATE_HZ, _plate(self.speed_mm_s, as_lit))


_plate = cache(passing_rates)
