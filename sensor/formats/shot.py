"""Frames of light on a sensor, and all that can be drawn of them.

Events and bits are drawn from the same light as the readings, from random streams of their own:
they agree with them in distribution, not count by count.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from megalopta.sensor import Exposure
from megalopta.sensor.readout import (
    Events,
    ImageSensor,
    expose_binary,
    expose_events,
    expose_image,
)
from megalopta.sensor.spad import Sensor, detection_rate

MOST_EVENTS = 5e7
"""Of a frame; they take about 3 GB of memory while they are drawn and sorted."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Shot:
    """Frames of light that fall on a sensor, and what it makes of them, drawn when asked for.

    Attributes
    ----------
    radiance : (T, H, W, B) array
    bands_nm : (B, 2) array
    sensor : Sensor or CtiaSensor
    seed : int
    sequence : str or int
    first_frame : int
    frame_period_s : float
        All as for `expose_image`.
    """

    radiance: ArrayLike
    bands_nm: ArrayLike
    sensor: ImageSensor
    seed: int
    sequence: str | int
    first_frame: int
    frame_period_s: float

    @cached_property
    def exposure(self) -> Exposure:
        """Readings, with what they are on average."""
        return expose_image(
            self.radiance,
            self.bands_nm,
            self.sensor,
            seed=self.seed,
            sequence=self.sequence,
            first_frame=self.first_frame,
            frame_period_s=self.frame_period_s,
            expectation=True,
        )

    @cached_property
    def _detections_hz(self) -> NDArray[np.float64]:
        return detection_rate(self.radiance, self.bands_nm, self._spad)

    def events(self) -> Iterator[Events]:
        """Events, frame by frame.

        Raises
        ------
        ValueError
            When there would be more of a frame than fit into memory.
        """
        for index, rate in enumerate(self._detections_hz):
            arrivals = float(rate.sum()) * self.sensor.exposure_s
            if arrivals > MOST_EVENTS:
                raise ValueError(
                    f"about {arrivals:.2g} events in a frame, more than {MOST_EVENTS:.0e}; give a "
                    "darker level, a shorter exposure_s or a smaller image, or no events"
                )
            frame = self.first_frame + index
            yield expose_events(
                rate[np.newaxis],
                self._spad,
                seed=self.seed,
                sequence=self.sequence,
                first_frame=frame,
            )

    @cached_property
    def bits(self) -> NDArray[np.uint8]:
        """Packed binary frames, (T, H, ceil(W/8))."""
        return expose_binary(
            self._detections_hz,
            self._spad,
            seed=self.seed,
            sequence=self.sequence,
            first_frame=self.first_frame,
        )

    @property
    def _spad(self) -> Sensor:
        if not isinstance(self.sensor, Sensor):
            raise ValueError(f"{self.sensor.name}: a sensor that integrates has no single events")
        return self.sensor
