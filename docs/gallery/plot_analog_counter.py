"""
An analog counter saturates
===========================

Readings of a counter with steps of 10 mV per event and a swing of 3.2 V. Gray points are readings
of single pixels. Saturated pixels are flagged. Theory: :doc:`/theory/counters`.
"""

import matplotlib.pyplot as plt
import numpy as np

from megalopta.sensor import changed, expose_rate, preset

sensor = changed(
    preset("spadcam"), exposure_s=0.01, dark_counts={"bulk_mean_hz_um2": 0.0, "hot_fraction": 0.0}
)
rates_hz = np.linspace(0, 5e4, 41)
light = np.broadcast_to(rates_hz[:, None, None], (41, 16, 16))
exposure = expose_rate(light, sensor, seed=0, stream="ramp")

events = rates_hz * sensor.exposure_s
plt.plot(events, exposure.counts.reshape(41, -1), ".", color="gray", ms=2)
plt.plot(events, exposure.counts.mean(axis=(1, 2)), label="mean reading")
plt.plot(events, events, ":", color="black", label="arrivals")
plt.plot(
    events, 100 * exposure.saturated.mean(axis=(1, 2)), label="flagged as saturated (% of pixels)"
)
plt.xlabel("mean arrivals in 10 ms")
plt.ylabel("reading (counts)")
plt.legend()
plt.show()
