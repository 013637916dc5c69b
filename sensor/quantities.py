"""Quantities of an exposure: readings, and their mean and variance.

Three quantities describe one scene on one device, averaged over temporal noise:

- photons on the pixel during the exposure, including its insensitive area;
- events: detections that reach the counter, after efficiency, dark counts, gate, dead time,
  afterpulsing and crosstalk; for an integrating sensor, collected electrons, including dark ones;
- reading: the output after the counter (capacity, step, leak, noise, ADC) or the rail.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats, Mask

Reals = NDArray[np.float32] | Floats


@dataclass(frozen=True, eq=False)
class Expectation:
    """Mean and variance of frames, each (T, H, W); float64, from a store float32."""

    photons: Reals
    """Mean number of photons on the pixel, equal to its variance."""
    mean_events: Reals
    events_variance: Reals
    """Moments of the detections that reach the counter (counts, counts²), or of collected
    electrons."""
    mean_reading: Reals
    reading_variance: Reals
    """Moments of `Exposure.counts`, in its unit and the square of it."""

    def signal_to_noise(self, brighter: "Expectation", by: float) -> Floats:
        """Signal from the light over the reading's standard deviation, (T, H, W).

        The signal follows from the slope of the reading at this light, as in EMVA 1288 (SNR
        referred to the exposure). It is near 0 where the pixel is saturated, negative where a
        paralyzable pixel reads less in more light, and 0 where readings never vary.

        `brighter`: expectation of the same sensor in light stronger by this fraction; `by`: much
        smaller than 1, such as 0.01.
        """
        signal = (np.asarray(brighter.mean_reading, np.float64) - self.mean_reading) / by
        noise = np.sqrt(np.asarray(self.reading_variance, np.float64))
        return np.divide(signal, noise, out=np.zeros_like(signal), where=noise > 0)


@dataclass(frozen=True, eq=False)
class Exposure:
    """Frames as read by the sensor."""

    counts: NDArray[np.uint16] | NDArray[np.uint32] | NDArray[np.float32]
    """(T, H, W): readings; unreliable where saturated. From an integrating sensor: electrons,
    float32."""
    saturated: Mask
    """(T, H, W): True where the pixel was saturated: the reading is a lower bound, or has
    wrapped."""
    expectation: Expectation | None = None
    """If requested."""
