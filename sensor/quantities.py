"""What an exposure is made of: readings, and what they are on average.

Three quantities are on average what they are for one scene on one device, without temporal noise:

- photons: that fall on the pixel during the exposure, on its insensitive area too;
- events: detections that reach the counter, after efficiency, dark counts, gate, dead time,
  afterpulsing and crosstalk; electrons collected, dark ones too, of a sensor that integrates;
- reading: what is read, after the counter (capacity, step, leak, noise, converter) or the rail.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats

Reals = NDArray[np.float32] | Floats


@dataclass(frozen=True, eq=False)
class Expectation:
    """Mean and variance of frames, each (T, H, W); float64, from a store float32.

    Attributes
    ----------
    photons : array
        Mean number of photons that fall on the pixel. It is its own variance.
    mean_events, events_variance : array
        Of the detections that reach the counter (counts, counts²), or of the electrons collected.
    mean_reading, reading_variance : array
        Of what `Exposure.counts` holds, in its unit and in its square.
    """

    photons: Reals
    mean_events: Reals
    events_variance: Reals
    mean_reading: Reals
    reading_variance: Reals

    def signal_to_noise(self, brighter: "Expectation", by: float) -> Floats:
        """What the light adds to the reading over the reading's standard deviation, (T, H, W).

        What it adds is taken from the slope of the reading at this light, as in EMVA 1288 (SNR
        referred to the exposure): next to nothing where the pixel is full, negative where a
        paralyzable pixel reads less the more it sees, 0 where readings never vary.

        Parameters
        ----------
        brighter : Expectation
            Of the same sensor in light that is stronger by this share.
        by : float
            Small against 1, such as 0.01.
        """
        signal = (np.asarray(brighter.mean_reading, np.float64) - self.mean_reading) / by
        noise = np.sqrt(np.asarray(self.reading_variance, np.float64))
        return np.divide(signal, noise, out=np.zeros_like(signal), where=noise > 0)


@dataclass(frozen=True, eq=False)
class Exposure:
    """Frames as the sensor read them.

    Attributes
    ----------
    counts : (T, H, W) uint16 or uint32
        Readings; not to be trusted where saturated. From a sensor that integrates: electrons,
        float32.
    saturated : (T, H, W) bool
        Where the pixel was full, so that the reading is a lower bound, or has wrapped.
    expectation : Expectation or None
        Where it was asked for.
    """

    counts: NDArray[np.uint16] | NDArray[np.uint32] | NDArray[np.float32]
    saturated: NDArray[np.bool_]
    expectation: Expectation | None = None
