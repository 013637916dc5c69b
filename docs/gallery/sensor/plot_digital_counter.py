"""
A counter of five bits saturates or wraps
=========================================

Mean reading of a counter with a capacity of 31 over the mean number of events. It saturates, or
starts again at zero. Points are simulated, lines are sums over the Poisson distribution. Theory:
:doc:`/theory/counters`.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.stats import poisson

from megalopta.sensor import changed, expose_rate, preset

CAPACITY = 31
means = np.linspace(1, 90, 24)
fine = np.linspace(0.5, 90, 200)
n = np.arange(250)
readings = {"saturate": np.minimum(n, CAPACITY), "wrap": n % (CAPACITY + 1)}
for overflow, read in readings.items():
    sensor = changed(
        preset("ideal"), exposure_s=1e-3, counter={"capacity": CAPACITY, "overflow": overflow}
    )
    light = np.broadcast_to(1e3 * means[:, None, None], (means.size, 40, 40))
    counts = expose_rate(light, sensor, seed=0, stream=overflow).counts.mean(axis=(1, 2))
    (line,) = plt.plot(fine, poisson.pmf(n, fine[:, None]) @ read, label=overflow)
    plt.plot(means, counts, "o", color=line.get_color())
plt.xlabel("mean events per exposure")
plt.ylabel("mean reading (counts)")
plt.legend()
plt.show()
